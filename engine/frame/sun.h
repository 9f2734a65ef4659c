// The Sun as a frame sees it: a direction, a distance, a disc or a point.
#pragma once

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

struct Sun {
  Vec3 direction = Vec3::UnitX();  // unit, from the Moon toward the Sun
  double distance_au = 1.0;
  double angular_radius_deg = 0.0;  // 0: a point Sun, hard shadows
  // u of the disc's brightness 1 - u (1 - mu), mu: cosine of the angle from the Sun's own vertical; 0: even. About 0.6
  // in the visible.
  double limb_darkening = 0.0;
};

// Of the Sun's disc at a distance. Its radius is 695 700 km: IAU 2015 resolution B3.
double sun_radius_deg(double distance_au);

// Unit vector toward a Sun that stands at a compass azimuth (clockwise from north) and an elevation over the horizontal
// of local axes.
Vec3 sun_direction(const EastNorthUp& local, double azimuth_deg, double elevation_deg);

}  // namespace selenograph::engine
