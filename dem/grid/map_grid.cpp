#include "dem/grid/map_grid.h"

#include <cmath>

namespace selenograph::dem {
namespace {

Vec3 unit(double lat_deg, double lon_deg) { return to_cartesian({lat_deg, lon_deg, 0}) / kMoonRadius_m; }

}  // namespace

MapTransform::MapTransform(const MapPlane& plane)
    : plane_(plane),
      metres_per_degree_(kMetresPerDegree * std::cos(plane.standard_parallel_deg * kRadiansPerDegree)),
      radius_m_(kMoonRadius_m * plane.scale),
      axes_(local_axes(plane.lat_deg, plane.lon_deg)) {}

// Snyder (12-3), (12-4).
std::optional<Vec3> MapTransform::from_equirectangular(const MapPoint& p) const {
  const double lat_deg = p.y_m / kMetresPerDegree;
  if (!(std::abs(lat_deg) <= 90)) return std::nullopt;
  return unit(lat_deg, wrap_lon_deg(plane_.lon_deg + p.x_m / metres_per_degree_));
}

// Snyder (21-15), (20-14), (20-15), as a vector: c is the angle from the origin, tan(c / 2) = rho / (2 R k0).
Vec3 MapTransform::from_stereographic(const MapPoint& p) const {
  const double x = p.x_m / (2 * radius_m_), y = p.y_m / (2 * radius_m_), half2 = x * x + y * y;
  return (2 * x * axes_.east + 2 * y * axes_.north + (1 - half2) * axes_.up) / (1 + half2);
}

// Snyder (20-14), (20-15), (20-19), as a vector.
std::optional<Vec3> MapTransform::from_orthographic(const MapPoint& p) const {
  const double x = p.x_m / kMoonRadius_m, y = p.y_m / kMoonRadius_m, up2 = 1 - x * x - y * y;
  if (!(up2 >= 0)) return std::nullopt;
  return x * axes_.east + y * axes_.north + std::sqrt(up2) * axes_.up;
}

// Snyder (7-4), (7-5) and, with its axis on the equator, (8-6), (8-7), as a vector: from the cylinder around `axis`
// that touches the sphere at the origin.
Vec3 MapTransform::from_cylinder(double around_m, double along_m, const Vec3& east, const Vec3& axis) const {
  const double around = around_m / radius_m_, along = along_m / radius_m_;
  return (std::sin(around) * east + std::cos(around) * axes_.up) / std::cosh(along) + std::tanh(along) * axis;
}

std::optional<Vec3> MapTransform::direction(const MapPoint& p) const {
  switch (plane_.projection) {
    case MapProjection::equirectangular:
      return from_equirectangular(p);
    case MapProjection::stereographic:
      return from_stereographic(p);
    case MapProjection::orthographic:
      return from_orthographic(p);
    case MapProjection::mercator:
      return from_cylinder(p.x_m, p.y_m, axes_.east, axes_.north);
    case MapProjection::transverse_mercator:
      return from_cylinder(p.y_m, p.x_m, axes_.north, axes_.east);
  }
  return std::nullopt;
}

std::optional<MapPoint> MapTransform::project(const Vec3& direction) const {
  const double east = direction.dot(axes_.east), north = direction.dot(axes_.north), up = direction.dot(axes_.up);
  switch (plane_.projection) {
    case MapProjection::equirectangular: {
      const Geographic g = to_geographic(direction * kMoonRadius_m);
      return project(g.lat_deg, g.lon_deg);
    }
    case MapProjection::stereographic:  // Snyder (21-2) to (21-4)
      if (!(1 + up > 0)) break;
      return MapPoint{2 * radius_m_ * east / (1 + up), 2 * radius_m_ * north / (1 + up)};
    case MapProjection::orthographic:  // Snyder (20-3), (20-4)
      if (up < 0) break;
      return MapPoint{kMoonRadius_m * east, kMoonRadius_m * north};
    case MapProjection::mercator:  // Snyder (7-1), (7-2)
      if (!(std::abs(north) < 1)) break;
      return MapPoint{radius_m_ * std::atan2(east, up), radius_m_ * std::atanh(north)};
    case MapProjection::transverse_mercator:  // Snyder (8-1), (8-3)
      if (!(std::abs(east) < 1)) break;
      return MapPoint{radius_m_ * std::atanh(east), radius_m_ * std::atan2(north, up)};
  }
  return std::nullopt;
}

std::optional<MapPoint> MapTransform::project(double lat_deg, double lon_deg) const {
  if (plane_.projection == MapProjection::equirectangular)  // Snyder (12-1), (12-2)
    return MapPoint{wrap_lon_deg(lon_deg - plane_.lon_deg) * metres_per_degree_, lat_deg * kMetresPerDegree};
  return project(unit(lat_deg, lon_deg));
}

}  // namespace selenograph::dem
