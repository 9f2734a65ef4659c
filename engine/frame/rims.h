// Rims of craters in an image: options and result of Renderer::rims.
#pragma once

#include <cstddef>
#include <vector>

#include "dem/detail/detail.h"
#include "dem/detail/features.h"

namespace selenograph::engine {

struct RimOptions {
  double least_px = 4;                      // diameter of the circle with the outline's area
  double least_depth = dem::Detail::kWorn;  // depth over diameter
};

// An image place in pixels; the centre of the top-left pixel is (0, 0).
struct RimPoint {
  double x_px, y_px;
};

struct CraterRim {
  dem::CraterFeature feature;
  RimPoint centre;  // centre of its floor; NaN: not imaged
  bool centre_visible = false;
  std::vector<RimPoint> outline;  // rim points in order; some may be outside the image
  double rim_visible = 0;         // share of the rim points that are in the image and visible
};

struct CraterRims {
  std::vector<CraterRim> rims;  // the largest first
  // Number of craters in view that are large enough but have rim points without an image place, for example behind a
  // pinhole.
  std::size_t cut_off = 0;
};

}  // namespace selenograph::engine
