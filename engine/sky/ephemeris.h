// Direction of the Sun as seen from the Moon at an epoch, and the constant rotations between lunar body frames.
#pragma once

#include <string>

#include "dem/grid/geodesy.h"
#include "engine/frame/indirect.h"

namespace selenograph::engine {

struct SunPosition {
  // Unit, MOON_ME, from the Moon's centre toward the apparent Sun: light time and aberration (20 arcsec) are included,
  // since shadows follow the arriving light. The Sun's parallax over the Moon's radius (2.4 arcsec) is not.
  Vec3 direction;
  double distance_au = 1;  // at the time the light left
};

// Returns the Sun's direction and distance. `utc` is ISO 8601 ("2026-11-20T00:00:00Z", or by day of the year
// "2026-324T00:00:00Z"; fraction and Z optional), 1960 to 2099. Throws ImpossibleRequest that names the error in it.
//
// Accuracy: 0.01 degrees in direction (the Sun's disc is 0.53 degrees wide), 1e-6 au in distance. The error budget is
// at the definition; nearly all of it is the lunar rotation.
SunPosition sun_at(const std::string& utc);

// Returns the Earth's centre as seen from the Moon's at a UTC epoch, with aberration. Accuracy: 0.01 degrees in
// direction, 100 km in distance. Throws as sun_at.
Earth earth_at(const std::string& utc);

// Returns the rotation from ICRF axes into MOON_ME at `later_s` seconds after a UTC epoch, as sun_at uses it. Accuracy:
// 0.01 degrees of rotation. Throws as sun_at.
Mat3 moon_me_from_icrf(const std::string& utc, double later_s = 0);

// A Julian date in two parts, which together keep microseconds.
struct JulianDate {
  double day = 0, fraction = 0;
};

// Returns the epoch in TT, which differs from TDB by at most 2 ms. Throws as sun_at.
JulianDate tt_at(const std::string& utc);

// Returns the UTC epoch, to a microsecond, of Ephemeris Time as in SPICE: seconds of TDB since J2000.0. Throws
// ImpossibleRequest outside 1960 to 2099.
std::string utc_of_et(double et_s);

enum class BodyFrame { moon_me, moon_pa_de421, moon_pa_de440 };

// Returns the constant rotation from the named frame into MOON_ME (DE421), by published angles.
Mat3 moon_me_from(BodyFrame frame);

}  // namespace selenograph::engine
