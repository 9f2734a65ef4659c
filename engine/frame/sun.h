// The Sun: direction, distance, and angular radius.
#pragma once

#include <optional>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

inline constexpr double kAstronomicalUnit_m = 149597870700;

struct Sun {
  Vec3 direction = Vec3::unit_x();  // unit vector from the Moon toward the Sun
  double distance_au = 1.0;
  double angular_radius_deg = 0.0;  // 0: a point Sun, hard shadows
  // Coefficient u of the disc's limb darkening, 1 - u (1 - mu), mu: cosine of the angle from the Sun's own vertical; 0:
  // uniform. About 0.6 in the visible. Empty: uniform for the light of the ground, 0.6 in view.
  std::optional<double> limb_darkening{};
};

// Returns the angular radius of the Sun at a distance. Solar radius 695 700 km: IAU 2015 resolution B3.
double sun_radius_deg(double distance_au);

// Returns unit vectors that are spread evenly over the Sun's disc, `across` of them along its diameter.
std::vector<Vec3> places_on_sun(const Vec3& direction, double radius_deg, int across);

// Returns the unit vector toward a Sun at a compass azimuth (clockwise from north) and an elevation over the horizontal
// plane of local axes.
Vec3 sun_direction(const EastNorthUp& local, double azimuth_deg, double elevation_deg);

}  // namespace selenograph::engine
