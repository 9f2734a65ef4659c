// Craters in an image: ground truth for crater detectors. What a request asks for, and what the report lists.
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

// The ellipse of which an outline's points are, as far as they are of one: for points in equal steps around a circle
// that is seen from afar it is exact, otherwise it has their mean and their covariance.
struct RimEllipse {
  RimPoint centre;
  double semi_major_px, semi_minor_px;
  double angle_deg;  // from the x axis to the major axis, toward y: in (-90, 90]
};
RimEllipse ellipse_of(const std::vector<RimPoint>& outline);

struct CraterRim {
  dem::CraterFeature feature;
  RimPoint centre;  // centre of its floor; NaN: not imaged
  bool centre_visible = false;
  std::vector<RimPoint> outline;  // rim points in order; some may be outside the image
  double rim_visible = 0;         // share of the rim points that the image shows
};

struct CraterRims {
  std::vector<CraterRim> rims;  // the largest first
  // Number of craters in view that are large enough but have rim points without an image place, for example behind a
  // pinhole.
  std::size_t cut_off = 0;
};

}  // namespace selenograph::engine
