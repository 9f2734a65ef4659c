#include "dem/grid/map_grid.h"

#include <Eigen/Geometry>
#include <cmath>

namespace selenograph::dem {
namespace {

Vec3 unit(double lat_deg, double lon_deg) { return to_cartesian({lat_deg, lon_deg, 0}) / kMoonRadius_m; }

}  // namespace

MapDirections::MapDirections(const MapPlane& plane)
    : plane_(plane),
      metres_per_degree_(kMetresPerDegree * std::cos(plane.standard_parallel_deg * kRadiansPerDegree)),
      axes_(local_axes(plane.lat_deg, plane.lon_deg)) {}

// Snyder (12-3), (12-4).
std::optional<Vec3> MapDirections::from_equirectangular(const MapPoint& p) const {
  const double lat_deg = p.y_m / kMetresPerDegree;
  if (!(std::abs(lat_deg) <= 90)) return std::nullopt;
  return unit(lat_deg, wrap_lon_deg(plane_.lon_deg + p.x_m / metres_per_degree_));
}

// Snyder (21-15), (20-16), (20-17), as a vector: c is the angle from the pole, tan(c / 2) = rho / (2 R).
Vec3 MapDirections::from_stereographic(const MapPoint& p) const {
  const double x = p.x_m / (2 * kMoonRadius_m), y = p.y_m / (2 * kMoonRadius_m), half2 = x * x + y * y;
  return (2 * x * axes_.east + 2 * y * axes_.north + (1 - half2) * axes_.up) / (1 + half2);
}

// Snyder (20-14), (20-15), (20-19), as a vector.
std::optional<Vec3> MapDirections::from_orthographic(const MapPoint& p) const {
  const double x = p.x_m / kMoonRadius_m, y = p.y_m / kMoonRadius_m, up2 = 1 - x * x - y * y;
  if (!(up2 >= 0)) return std::nullopt;
  return x * axes_.east + y * axes_.north + std::sqrt(up2) * axes_.up;
}

std::optional<Vec3> MapDirections::operator()(const MapPoint& point) const {
  switch (plane_.projection) {
    case MapProjection::equirectangular:
      return from_equirectangular(point);
    case MapProjection::polar_stereographic:
      return from_stereographic(point);
    case MapProjection::orthographic:
      return from_orthographic(point);
  }
  return std::nullopt;
}

std::optional<MapPoint> MapPlane::place(double at_lat_deg, double at_lon_deg) const {
  const double east_deg = wrap_lon_deg(at_lon_deg - lon_deg);
  switch (projection) {
    case MapProjection::equirectangular:
      return MapPoint{east_deg * kMetresPerDegree * std::cos(standard_parallel_deg * kRadiansPerDegree),
                      at_lat_deg * kMetresPerDegree};
    case MapProjection::polar_stereographic: {  // Snyder (21-5) to (21-12)
      const double sign = lat_deg > 0 ? 1 : -1;
      if (sign * at_lat_deg <= -90) return std::nullopt;
      const double rho = 2 * kMoonRadius_m * std::tan((90 - sign * at_lat_deg) / 2 * kRadiansPerDegree);
      return MapPoint{rho * std::sin(east_deg * kRadiansPerDegree),
                      -sign * rho * std::cos(east_deg * kRadiansPerDegree)};
    }
    case MapProjection::orthographic: {  // Snyder (20-3), (20-4)
      const EastNorthUp axes = local_axes(lat_deg, lon_deg);
      const Vec3 p = unit(at_lat_deg, at_lon_deg);
      if (p.dot(axes.up) < 0) return std::nullopt;
      return MapPoint{kMoonRadius_m * p.dot(axes.east), kMoonRadius_m * p.dot(axes.north)};
    }
  }
  return std::nullopt;
}

}  // namespace selenograph::dem
