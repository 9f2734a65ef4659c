#include "engine/frame/sun.h"

#include <algorithm>
#include <cmath>

namespace selenograph::engine {

double sun_radius_deg(double distance_au) {
  constexpr double kRadius_m = 695700e3;
  return std::asin(std::min(1.0, kRadius_m / (distance_au * kAstronomicalUnit_m))) * kDegreesPerRadian;
}

std::vector<Vec3> places_on_sun(const Vec3& direction, double radius_deg, int across) {
  const EastNorthUp axes = local_axes(direction);
  const double radius = std::sin(radius_deg * kRadiansPerDegree);
  std::vector<Vec3> places;
  for (int j = 0; j < across; ++j)
    for (int i = 0; i < across; ++i) {
      const double x = (2 * i + 1.0) / across - 1, y = (2 * j + 1.0) / across - 1;
      if (x * x + y * y <= 1) places.push_back((direction + radius * (x * axes.east + y * axes.north)).normalized());
    }
  return places;
}

Vec3 sun_direction(const EastNorthUp& local, double azimuth_deg, double elevation_deg) {
  const double azimuth = azimuth_deg * kRadiansPerDegree, elevation = elevation_deg * kRadiansPerDegree;
  const Vec3 horizontal = std::cos(azimuth) * local.north + std::sin(azimuth) * local.east;
  return (std::cos(elevation) * horizontal + std::sin(elevation) * local.up).normalized();
}

}  // namespace selenograph::engine
