// Objects in the sky besides the Moon: stars, the Sun, the Earth, planets.
#pragma once

#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {
class ValueMap;
}

namespace selenograph::engine {

class StarCatalogue;

// Reflectance over the Earth by geodetic latitude and longitude, relative to the rest of the Earth.
struct EarthMap {
  std::string name;
  std::shared_ptr<const dem::ValueMap> content;  // null: none
};

// State of a body relative to the Moon's centre, ICRF axes, as spkezr of SPICE has it with the correction "LT": the
// Moon at the epoch, the body when the light left that reaches the Moon's centre then.
struct BodyState {
  Vec3 position_m = Vec3::zero(), velocity_m_s = Vec3::zero();
};
using BodyStates = std::map<std::string, BodyState, std::less<>>;  // by the names of /v1/sky: "sun", "earth", "venus"

struct SkyOptions {
  std::string utc;                             // epoch
  std::shared_ptr<const StarCatalogue> stars;  // null: none
  double magnitude_limit = 6.5;                // limit of the stars' V magnitude
  bool sun = false, earth = false, planets = false;
  EarthMap earth_map;
  // Velocity of the camera relative to the Moon's centre, in inertial space (without the Moon's rotation), along axes
  // of MOON_ME: for aberration.
  Vec3 velocity_m_s = Vec3::zero();
  BodyStates states;  // of an ephemeris; bodies without one have the theories of SkyObserver
  bool any() const { return stars || sun || earth || planets; }
};

enum class SkyKind { star, sun, earth, planet };

// First occluder on the line of sight to a distant object. The numbers are those of arrays.
enum class HiddenBy { none, moon, object, earth };

struct SkyObject {
  SkyKind kind = SkyKind::star;
  std::string id;  // a star's identifier in its catalogue; a planet's name
  Vec3 direction_icrf = Vec3::zero(),
       direction = Vec3::zero();  // unit vectors, apparent; `direction` along axes of MOON_ME
  double v_mag = 0;
  double irradiance_w_m2 = 0;  // at normal incidence, in the request's band
  // irradiance_w_m2, weighted as the detector counts photons (in_photons); 0 without a sensor
  double counted_w_m2 = 0;
  // Distance of the camera from the centre, and phase angle, of the Sun, the Earth and planets.
  std::optional<double> distance_m{}, phase_deg{};
  double x_px = std::numeric_limits<double>::quiet_NaN(), y_px = x_px;  // NaN: not imaged
  bool in_frame = false;
  HiddenBy hidden_by = HiddenBy::none;  // first occluder of a ray to the centre
  std::optional<double> electrons{};  // expected electrons in the object's full image; empty: no sensor, or not imaged
};

}  // namespace selenograph::engine
