#include "dem/grid/geodesy.h"

#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/Math.hpp>

namespace selenograph {
namespace {

// A sphere: GeographicLib's defaults are WGS84, so radius and flattening are always given.
const GeographicLib::Geocentric& moon() {
  static const GeographicLib::Geocentric sphere(kMoonRadius_m, 0.0);
  return sphere;
}

}  // namespace

Vec3 to_cartesian(const Geographic& g) {
  Vec3 p;
  moon().Forward(g.lat_deg, g.lon_deg, g.height_m, p.x(), p.y(), p.z());
  return p;
}

Geographic to_geographic(const Vec3& p_m) {
  Geographic g;
  if (p_m.squaredNorm() == 0) return {0, 0, -kMoonRadius_m};
  moon().Reverse(p_m.x(), p_m.y(), p_m.z(), g.lat_deg, g.lon_deg, g.height_m);
  g.lon_deg = wrap_lon_deg(g.lon_deg);
  return g;
}

double wrap_lon_deg(double lon_deg) {
  if (lon_deg >= -180 && lon_deg < 180) return lon_deg;  // a division less
  const double wrapped = GeographicLib::Math::AngNormalize(lon_deg);
  return wrapped >= 180.0 ? -180.0 : wrapped;
}

std::optional<Vec3> on_sphere(const Vec3& from_m, const Vec3& direction) {
  const double along = -from_m.dot(direction), off_axis2 = from_m.squaredNorm() - along * along,
               half2 = kMoonRadius_m * kMoonRadius_m - off_axis2;
  if (!(half2 > 0 && along > 0)) return std::nullopt;
  return from_m + (along - std::sqrt(half2)) * direction;
}

EastNorthUp local_axes(double lat_deg, double lon_deg) {
  double sin_lat, cos_lat, sin_lon, cos_lon;
  GeographicLib::Math::sincosd(lat_deg, sin_lat, cos_lat);
  GeographicLib::Math::sincosd(lon_deg, sin_lon, cos_lon);
  return {{-sin_lon, cos_lon, 0},
          {-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat},
          {cos_lat * cos_lon, cos_lat * sin_lon, sin_lat}};
}

EastNorthUp local_axes(const Vec3& p_m) {
  const Vec3 up = p_m.normalized();
  const double ring = std::hypot(up.x(), up.y());
  const Vec3 east = ring > 0 ? Vec3(-up.y() / ring, up.x() / ring, 0) : Vec3(0, 1, 0);
  return {east, up.cross(east), up};
}

}  // namespace selenograph
