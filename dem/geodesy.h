// The Moon as a sphere: MOON_ME geographic coordinates <-> MOON_ME Cartesian metres.
//
// Latitude is planetocentric, longitude east-positive, height above the sphere of 1 737 400 m. Degrees at this border.
// Everything is double: float has 0.125 m resolution at this radius.
#pragma once

#include <Eigen/Core>

namespace selenograph {

using Vec3 = Eigen::Vector3d;

// Mean lunar radius, the vertical datum of Kaguya and LOLA products (IAU WGCCRE 2009, Archinal et al. 2011, table 5).
inline constexpr double kMoonRadius_m = 1737400.0;

struct Geographic {
  double lat_deg = 0;
  double lon_deg = 0;
  double height_m = 0;
};

// Exact at multiples of 90 degrees: at a pole x and y are zero whatever the longitude.
Vec3 to_cartesian(const Geographic& g);

// Longitude in [-180, 180). Defined everywhere but at the centre, where it answers latitude and longitude 0.
Geographic to_geographic(const Vec3& p_m);

// Wraps into [-180, 180).
double wrap_lon_deg(double lon_deg);

struct EastNorthUp {
  Vec3 east, north, up;
};

// Local axes at a direction from the Moon's centre. At a pole, where east is undefined, longitude 0 is taken.
EastNorthUp local_axes(const Vec3& p_m);

}  // namespace selenograph
