// Rims of craters in an image: what Renderer::rims is asked for and answers.
#pragma once

#include <cstddef>
#include <vector>

#include "dem/detail/detail.h"
#include "dem/detail/features.h"

namespace selenograph::engine {

struct RimOptions {
  double least_px = 4;                      // diameter of a circle of the outline's area
  double least_depth = dem::Detail::kWorn;  // over the diameter
};

// A place in the image, as the contract counts: the centre of the top-left pixel is (0, 0).
struct RimPoint {
  double x_px, y_px;
};

struct CraterRim {
  dem::CraterFeature feature;
  RimPoint centre;  // of its floor; NaN: not imaged
  bool centre_visible = false;
  std::vector<RimPoint> outline;  // of the rim, in order; it may leave the image
  double rim_visible = 0;         // share of its points that are in the image and not hidden
};

struct CraterRims {
  std::vector<CraterRim> rims;  // the largest first
  // Large enough and in view, but with a part of the rim that the camera can't image: behind a pinhole, say.
  std::size_t cut_off = 0;
};

}  // namespace selenograph::engine
