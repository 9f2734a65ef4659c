#include "dem/grid/geodesy.h"

#include <cmath>
#include <limits>

#include "dem/grid/degrees.h"

namespace selenograph {

Vec3 to_cartesian(const Geographic& g) {
  if (std::abs(g.lat_deg) > 90) return Vec3::constant(std::numeric_limits<double>::quiet_NaN());
  const SineCosine lat = sine_cosine_of_deg(g.lat_deg), lon = sine_cosine_of_deg(g.lon_deg);
  const double radius_m = kMoonRadius_m + g.height_m, ring_m = radius_m * lat.cosine;
  return {ring_m * lon.cosine, ring_m * lon.sine, radius_m * lat.sine};
}

Geographic to_geographic(const Vec3& p_m) {
  if (p_m.squared_norm() == 0) return {0, 0, -kMoonRadius_m};
  const double ring_m = std::hypot(p_m.x(), p_m.y()), radius_m = std::hypot(ring_m, p_m.z());
  Geographic g;
  g.lat_deg = atan2_deg(p_m.z() / radius_m, ring_m / radius_m);
  if (ring_m != 0) g.lon_deg = wrap_lon_deg(atan2_deg(p_m.y() / ring_m, p_m.x() / ring_m));
  g.height_m = radius_m - kMoonRadius_m;
  return g;
}

double wrap_lon_deg(double lon_deg) {
  if (lon_deg >= -180 && lon_deg < 180) return lon_deg;  // saves a division in the usual case
  const double wrapped = std::remainder(lon_deg, 360.0);
  return wrapped >= 180.0 ? -180.0 : wrapped;
}

// Solves for the first intersection from the triangle of the centre, the nearest point of the ray, and an intersection:
//
//   from ----------- o ======= x ======= o        x  nearest point of the ray's line to the centre
//   |<------- along ---------->|<- half ->|       half^2 = R^2 - |centre - x|^2
std::optional<Vec3> on_sphere(const Vec3& from_m, const Vec3& direction) {
  const double along = -from_m.dot(direction), off_axis2 = from_m.squared_norm() - along * along,
               half2 = kMoonRadius_m * kMoonRadius_m - off_axis2;
  if (!(half2 > 0 && along > 0)) return std::nullopt;
  return from_m + (along - std::sqrt(half2)) * direction;
}

EastNorthUp local_axes(double lat_deg, double lon_deg) {
  const auto [sin_lat, cos_lat] = sine_cosine_of_deg(lat_deg);
  const auto [sin_lon, cos_lon] = sine_cosine_of_deg(lon_deg);
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
