#include "dem/map_grid.h"

#include <cmath>

namespace selenograph::dem {
namespace {

Vec3 unit(double lat_deg, double lon_deg) { return to_cartesian({lat_deg, lon_deg, 0}) / kMoonRadius_m; }

// Snyder (12-3), (12-4).
std::optional<Vec3> from_equirectangular(const MapPlane& plane, const MapPoint& p) {
  const double lat_deg = p.y_m / kMetresPerDegree;
  if (!(std::abs(lat_deg) <= 90)) return std::nullopt;
  const double shrink = std::cos(plane.standard_parallel_deg * kRadiansPerDegree);
  return unit(lat_deg, wrap_lon_deg(plane.lon_deg + p.x_m / (kMetresPerDegree * shrink)));
}

// Snyder (21-15), (20-16), (20-17), as a vector: c is the angle from the pole, tan(c / 2) = rho / (2 R).
Vec3 from_stereographic(const MapPlane& plane, const MapPoint& p) {
  const bool north = plane.lat_deg > 0;
  const double half = std::hypot(p.x_m, p.y_m) / (2 * kMoonRadius_m);
  const double cosine = (1 - half * half) / (1 + half * half), sine_by_rho = 1 / (kMoonRadius_m * (1 + half * half));
  // Along the central meridian and a quarter turn east of it.
  const double along = (north ? -p.y_m : p.y_m) * sine_by_rho, east = p.x_m * sine_by_rho;
  const double lon0 = plane.lon_deg * kRadiansPerDegree, c = std::cos(lon0), s = std::sin(lon0);
  return {along * c - east * s, along * s + east * c, north ? cosine : -cosine};
}

// Snyder (20-14), (20-15), (20-19), as a vector.
std::optional<Vec3> from_orthographic(const MapPlane& plane, const MapPoint& p) {
  const double x = p.x_m / kMoonRadius_m, y = p.y_m / kMoonRadius_m, up2 = 1 - x * x - y * y;
  if (!(up2 >= 0)) return std::nullopt;
  const EastNorthUp axes = local_axes(unit(plane.lat_deg, plane.lon_deg));
  return x * axes.east + y * axes.north + std::sqrt(up2) * axes.up;
}

}  // namespace

std::optional<Vec3> MapPlane::direction(const MapPoint& point) const {
  switch (projection) {
    case MapProjection::equirectangular:
      return from_equirectangular(*this, point);
    case MapProjection::polar_stereographic:
      return from_stereographic(*this, point);
    case MapProjection::orthographic:
      return from_orthographic(*this, point);
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
      const EastNorthUp axes = local_axes(unit(lat_deg, lon_deg));
      const Vec3 p = unit(at_lat_deg, at_lon_deg);
      if (p.dot(axes.up) < 0) return std::nullopt;
      return MapPoint{kMoonRadius_m * p.dot(axes.east), kMoonRadius_m * p.dot(axes.north)};
    }
  }
  return std::nullopt;
}

}  // namespace selenograph::dem
