// Craters in an image, as ground truth for crater detectors: options of a request, and the list in the report.
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

// An image position in pixels; the centre of the top-left pixel is (0, 0).
struct RimPoint {
  double x_px, y_px;
};

// Ellipse of an outline, with the mean and covariance of its points. It is exact for points in equal steps around a
// circle that is viewed from afar.
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
  // Number of craters in view that are large enough but have rim points without an image position, for example behind a
  // pinhole.
  std::size_t cut_off = 0;
};

}  // namespace selenograph::engine
