#include "engine/frame/sun.h"

#include <algorithm>
#include <cmath>

namespace selenograph::engine {

double sun_radius_deg(double distance_au) {
  constexpr double kRadius_km = 695700, kAu_km = 149597870.7;
  return std::asin(std::min(1.0, kRadius_km / (distance_au * kAu_km))) * kDegreesPerRadian;
}

Vec3 sun_direction(const EastNorthUp& local, double azimuth_deg, double elevation_deg) {
  const double azimuth = azimuth_deg * kRadiansPerDegree, elevation = elevation_deg * kRadiansPerDegree;
  const Vec3 horizontal = std::cos(azimuth) * local.north + std::sin(azimuth) * local.east;
  return (std::cos(elevation) * horizontal + std::sin(elevation) * local.up).normalized();
}

}  // namespace selenograph::engine
