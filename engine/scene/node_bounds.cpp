#include "engine/scene/node_bounds.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "dem/terrain/terrain.h"

namespace selenograph::engine {

NodeBounds bounds_of(const dem::BlockId& id, double low_m, double high_m) {
  return bounds_over(dem::extent_of(id), low_m, high_m);
}

NodeBounds bounds_over(const dem::BlockExtent& e, double low_m, double high_m) {
  const double south = dem::lat_deg_of(e.lat0) * kRadiansPerDegree,
               north = dem::lat_deg_of(e.lat1()) * kRadiansPerDegree;
  const double west = dem::lon_deg_of(e.lon0) * kRadiansPerDegree, east = dem::lon_deg_of(e.lon1()) * kRadiansPerDegree;
  NodeBounds b;
  b.low_m = low_m;
  b.high_m = high_m;
  double cos_lon[3], sin_lon[3];
  for (int i = 0; i < 3; ++i) {
    const double lon = west + (east - west) * i / 2;
    cos_lon[i] = std::cos(lon);
    sin_lon[i] = std::sin(lon);
  }
  std::size_t n = 0;
  for (int j = 0; j < 3; ++j) {
    const double lat = south + (north - south) * j / 2, cos_lat = std::cos(lat), sin_lat = std::sin(lat);
    for (int i = 0; i < 3; ++i) {
      const Vec3 up(cos_lat * cos_lon[i], cos_lat * sin_lon[i], sin_lat);
      b.points[n++] = up * (kMoonRadius_m + low_m);
      b.points[n++] = up * (kMoonRadius_m + high_m);
    }
  }
  // Sagitta of half a step along both axes. A parallel's is R cos(lat) (step / 2)^2 / 2, the larger one near a pole.
  const double step_lat = (north - south) / 2, step_lon = (east - west) / 2;
  b.bulge_m = (kMoonRadius_m + high_m) *
              (step_lat * step_lat + std::max(std::cos(south), std::cos(north)) * step_lon * step_lon) / 8;
  b.centre = (b.points[8] + b.points[9]) / 2;
  b.radius_m = 0;
  for (const Vec3& p : b.points) b.radius_m = std::max(b.radius_m, (p - b.centre).norm());
  b.radius_m += b.bulge_m;
  return b;
}

NodeBounds bounds_of_all(const dem::BlockId& id, double low_m, double high_m) {
  NodeBounds b = bounds_of(id, low_m, high_m);
  // The centre for a narrower range lies within half of the difference in range. Its sphere is at most half of its
  // range larger than that of level ground.
  b.radius_m = (high_m - low_m) / 2 + bounds_of(id, high_m, high_m).radius_m;
  return b;
}

bool below_horizon(const Vec3& from_m, const NodeBounds& b, double around_m) {
  using dem::kCoreRadius_m;
  const double distance = from_m.norm();
  if (distance - around_m <= kCoreRadius_m) return false;
  // Angle at the Moon's centre from the viewer to the horizon, plus the angle from there to a point that just rises
  // above it at the block's height.
  const double reach = std::acos(kCoreRadius_m / (distance + around_m)) +
                       std::acos(std::min(1.0, kCoreRadius_m / (kMoonRadius_m + b.high_m)));
  const double to_centre = std::acos(std::clamp(from_m.dot(b.centre) / (distance * b.centre.norm()), -1.0, 1.0));
  // Positions within around_m differ in direction from the Moon's centre by at most this angle.
  const double viewer_angle = std::asin(std::min(1.0, around_m / distance));
  return to_centre - std::asin(std::min(1.0, b.radius_m / b.centre.norm())) - viewer_angle > reach;
}

NodeBounds bounds_around(const Vec3& centre_m, double radius_m) {
  NodeBounds bounds;
  bounds.points.fill(centre_m);
  bounds.bulge_m = radius_m;
  bounds.centre = centre_m;
  bounds.radius_m = radius_m;
  const double height = centre_m.norm() - kMoonRadius_m;
  bounds.low_m = height - radius_m;
  bounds.high_m = height + radius_m;
  return bounds;
}

}  // namespace selenograph::engine
