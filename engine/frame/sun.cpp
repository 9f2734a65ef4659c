#include "engine/frame/sun.h"

#include <algorithm>
#include <cmath>

namespace selenograph::engine {

double sun_radius_deg(double distance_au) {
  constexpr double kRadius_m = 695700e3;
  return std::asin(std::min(1.0, kRadius_m / (distance_au * kAstronomicalUnit_m))) * kDegreesPerRadian;
}

Vec3 sun_direction(const EastNorthUp& local, double azimuth_deg, double elevation_deg) {
  const double azimuth = azimuth_deg * kRadiansPerDegree, elevation = elevation_deg * kRadiansPerDegree;
  const Vec3 horizontal = std::cos(azimuth) * local.north + std::sin(azimuth) * local.east;
  return (std::cos(elevation) * horizontal + std::sin(elevation) * local.up).normalized();
}

}  // namespace selenograph::engine
