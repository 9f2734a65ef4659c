// Apparent directions of stars, the Sun, the Earth and planets for an observer near the Moon.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "engine/frame/sky.h"
#include "engine/sky/ephemeris.h"
#include "engine/sky/star_catalogue.h"

namespace selenograph::engine {

enum class Planet { mercury, venus, earth, mars, jupiter, saturn, uranus, neptune };
// Returns the name in lower case, as in requests and answers.
std::string_view planet_name(Planet planet);
// Returns all planets but the Earth.
std::span<const Planet> other_planets();

// A body of the Solar System at the time when the light left it that arrives at the epoch.
struct ApparentBody {
  Vec3 direction;             // unit, ICRF axes, with light time and aberration
  double distance_m = 0;      // from the observer, along the light's path
  double sun_distance_m = 0;  // from the Sun to the body
  double phase_deg = 0;       // angle at the body between the Sun and the observer; 0 for the Sun
  Vec3 from_sun = Vec3::zero(), from_observer = Vec3::zero();  // unit, ICRF axes, without aberration: toward the body
};

// Positions of the Moon and the Earth are ERFA's, by eraMoon98 (31.7 km) and eraEpv00 (11.2 km; ephemeris.cpp has the
// budget). Those of the other planets are VSOP87's (Bretagnon & Francou, A&A 202, 309, 1988), evaluated by libnova.
// Seen from the Moon in 1960 to 2099 they are within 0.1 arcsec (Mercury), 0.2 (Venus), 0.5 (Mars, Jupiter, Saturn), 2
// (Uranus) and 3 (Neptune) of JPL's DE431 (unit.sky). Directions of stars agree with astropy to 0.001 arcsec.
// An error of 31.7 km in the Moon's position turns the Earth by 17 arcsec as seen from there. Directions in MOON_ME
// also have the error of the Moon's rotation, 0.01 degrees; those in ICRF axes do not.
//
// Bodies with a BodyState have the state's accuracy instead, to 0.001 arcsec: light time to the observer, aberration,
// and the Sun's deflection of the light of planets are added to it.
class SkyObserver {
 public:
  // `position_m`, `velocity_m_s`: relative to the Moon's centre along axes of MOON_ME; the velocity is inertial, so it
  // excludes the Moon's rotation. Throws ImpossibleRequest for a bad epoch.
  SkyObserver(const std::string& utc, const Vec3& position_m, const Vec3& velocity_m_s, BodyStates states = {});
  ~SkyObserver();
  SkyObserver(const SkyObserver&) = delete;
  SkyObserver& operator=(const SkyObserver&) = delete;

  const Mat3& moon_me_from_icrf() const { return moon_me_from_icrf_; }
  double years_since_j2000() const { return years_; }

  // Returns the apparent direction, unit, ICRF axes, with proper motion, parallax, deflection of light by the Sun, and
  // aberration.
  Vec3 apparent(const Star& star) const;
  // Upper bound on parallax and deflection.
  static constexpr double kMaxParallaxAndDeflection_rad = 1.5e-5;

  // Returns the rotation from ICRF axes into the Earth's (ITRF: +z the pole, +x Greenwich) at the time when the light
  // left the Earth that arrives from `distance_m`. IAU 2000B; UT1 is taken as UTC, which is right to 0.9 s or 0.004
  // degrees.
  Mat3 earth_from_icrf(double distance_m) const;

  ApparentBody sun() const;
  ApparentBody planet(Planet planet) const;

 private:
  struct Astrometry;  // wraps ERFA's context
  ApparentBody body_at(const Vec3& from_observer_au, const Vec3& from_sun_au) const;
  std::optional<Vec3> from_observer_by_state(std::string_view name) const;
  ApparentBody planet_by_state(const Vec3& from_observer_au) const;

  JulianDate date_;
  Mat3 moon_me_from_icrf_;
  double years_;
  BodyStates states_;
  Vec3 from_moon_m_, moon_velocity_m_s_;  // of the observer; of the Moon, barycentric. ICRF axes
  std::unique_ptr<Astrometry> astrometry_;
};

}  // namespace selenograph::engine
