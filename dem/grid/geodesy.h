// The Moon as a sphere: MOON_ME geographic coordinates <-> MOON_ME Cartesian metres.
//
// Latitude is planetocentric, longitude east-positive, height above the sphere of 1 737 400 m; interfaces use degrees.
// All coordinates are double: float has a resolution of 0.125 m at this radius.
#pragma once

#include <cmath>
#include <numbers>
#include <optional>

#include "dem/grid/vec.h"

namespace selenograph {

// Mean lunar radius, the vertical datum of Kaguya and LOLA products (IAU WGCCRE 2009, Archinal et al. 2011, table 5).
inline constexpr double kMoonRadius_m = 1737400.0;

// The conversion between degrees (in interfaces, and in every name that ends in _deg) and radians (in arithmetic only).
inline constexpr double kRadiansPerDegree = std::numbers::pi / 180;
inline constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
// Length along a great circle of the sphere: a degree of latitude everywhere, a degree of longitude at the equator.
inline constexpr double kMetresPerDegree = kMoonRadius_m * kRadiansPerDegree;

struct Geographic {
  double lat_deg = 0;
  double lon_deg = 0;
  double height_m = 0;
};

// Returns Cartesian coordinates, exact at multiples of 90 degrees: at a pole x and y are zero for any longitude.
Vec3 to_cartesian(const Geographic& g);

// Returns geographic coordinates, the longitude in [-180, 180). The Moon's centre has latitude and longitude 0.
Geographic to_geographic(const Vec3& p_m);

// Wraps a longitude into [-180, 180).
double wrap_lon_deg(double lon_deg);

// Returns the angle between two directions of any length, rad.
inline double angle_between(const Vec3& a, const Vec3& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

// Returns the first intersection of a ray from outside with the sphere of height 0; empty if it misses. `direction` is
// a unit vector.
std::optional<Vec3> on_sphere(const Vec3& from_m, const Vec3& direction);

struct EastNorthUp {
  Vec3 east, north, up;
};

// Returns the local axes at a position. At a pole they are those of the meridian `lon_deg`, as next to the pole.
EastNorthUp local_axes(double lat_deg, double lon_deg);
// Returns the local axes at a direction from the Moon's centre; at a pole, those of longitude 0.
EastNorthUp local_axes(const Vec3& p_m);

}  // namespace selenograph
