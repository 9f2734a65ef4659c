#include "engine/sky/sky_observer.h"

#include <erfa.h>
#include <erfam.h>
#include <libnova/libnova.h>

#include <cmath>
#include <mutex>
#include <utility>

#include "dem/grid/rotation.h"
#include "engine/sky/erfa_rows.h"

namespace selenograph::engine {
namespace {

constexpr double kLightDaysPerAu = ERFA_AULT / ERFA_DAYSEC;

// The Earth's position and velocity from the Sun and from the solar system's barycentre, ICRS axes, au and au per day.
struct EarthMotion {
  PositionVelocity from_sun, from_barycentre;
  Vec3 sun_from_barycentre() const { return (from_barycentre - from_sun).position; }
};

// Returns the Earth's motion `days_before` a date.
EarthMotion earth_motion(const JulianDate& date, double days_before = 0) {
  ErfaMotion from_sun, from_barycentre;
  eraEpv00(date.day, date.fraction - days_before, from_sun.rows, from_barycentre.rows);
  return {from_sun.motion(), from_barycentre.motion()};
}

// Returns the heliocentric ecliptic coordinates (J2000.0) of a planet other than the Earth.
ln_helio_posn ecliptic_position(Planet planet, double tt_jd) {
  using Theory = void (*)(double, ln_helio_posn*);
  static constexpr Theory kTheories[] = {
      ln_get_mercury_helio_coords, ln_get_venus_helio_coords,  ln_get_earth_helio_coords,  ln_get_mars_helio_coords,
      ln_get_jupiter_helio_coords, ln_get_saturn_helio_coords, ln_get_uranus_helio_coords, ln_get_neptune_helio_coords};
  // Lock: libnova caches each planet's last position in static variables.
  static std::mutex libnova_mutex;
  const std::scoped_lock lock(libnova_mutex);
  ln_helio_posn position{};
  kTheories[static_cast<std::size_t>(planet)](tt_jd, &position);
  return position;
}

// Returns a planet's position relative to the Sun's centre, ICRF axes, au, `days_before` the date. The Earth's is that
// of eraEpv00, as everywhere else in the sky.
Vec3 planet_from_sun(Planet planet, const JulianDate& date, double days_before) {
  if (planet == Planet::earth) return earth_motion(date, days_before).from_sun.position;
  const ln_helio_posn position = ecliptic_position(planet, date.day + (date.fraction - days_before));
  const double longitude = position.L * kRadiansPerDegree, latitude = position.B * kRadiansPerDegree,
               obliquity = eraObl80(ERFA_DJ00, 0);
  const Vec3 ecliptic = position.R * Vec3(std::cos(latitude) * std::cos(longitude),
                                          std::cos(latitude) * std::sin(longitude), std::sin(latitude));
  return AngleAxis(obliquity, Vec3::unit_x()) * ecliptic;
}

// Returns the barycentric position of a body at the time when the light left it that arrives now, au.
// position(days_before) returns the body's position. Each pass divides the error of the light time by 4000 or more.
template <typename Position>
Vec3 at_departure(const Vec3& observer, const Position& position, int passes = 4) {
  double days = 0;
  for (int i = 0; i < passes; ++i) days = (position(days) - observer).norm() * kLightDaysPerAu;
  return position(days);
}

}  // namespace

std::string_view planet_name(Planet planet) {
  constexpr std::string_view kNames[] = {"mercury", "venus", "earth", "mars", "jupiter", "saturn", "uranus", "neptune"};
  return kNames[static_cast<std::size_t>(planet)];
}

std::span<const Planet> other_planets() {
  static constexpr Planet kPlanets[] = {Planet::mercury, Planet::venus,  Planet::mars,   Planet::jupiter,
                                        Planet::saturn,  Planet::uranus, Planet::neptune};
  return kPlanets;
}

struct SkyObserver::Astrometry {
  eraASTROM context{};
  Vec3 position() const { return Vec3(context.eb); }  // of the observer, from the barycentre, au
  // Applies aberration, including the term of the Sun's potential at the observer.
  // Returns the direction in which the observer sees light that arrives from `natural`, both unit vectors.
  Vec3 aberrated(Vec3 natural) const {
    Vec3 proper;
    eraAb(natural.data(), const_cast<double*>(context.v), context.em, context.bm1, proper.data());
    return proper;
  }
};

SkyObserver::SkyObserver(const std::string& utc, const Vec3& position_m, const Vec3& velocity_m_s, BodyStates states)
    : date_(tt_at(utc)),
      moon_me_from_icrf_(engine::moon_me_from_icrf(utc)),
      years_(((date_.day - ERFA_DJ00) + date_.fraction) / ERFA_DJY),
      states_(std::move(states)),
      from_moon_m_(moon_me_from_icrf_.transpose_times(position_m)),
      astrometry_(std::make_unique<Astrometry>()) {
  const EarthMotion earth = earth_motion(date_);
  ErfaMotion moon_rows;
  eraMoon98(date_.day, date_.fraction, moon_rows.rows);
  const PositionVelocity moon = moon_rows.motion();
  const PositionVelocity observer{
      ERFA_DAU * moon.position + from_moon_m_,
      ERFA_DAU / ERFA_DAYSEC * moon.velocity + moon_me_from_icrf_.transpose_times(velocity_m_s)};
  moon_velocity_m_s_ = ERFA_DAU / ERFA_DAYSEC * (earth.from_barycentre.velocity + moon.velocity);
  Vec3 from_sun = earth.from_sun.position;
  ErfaMotion observer_rows(observer), earth_rows(earth.from_barycentre);
  eraApcs(date_.day, date_.fraction, observer_rows.rows, earth_rows.rows, from_sun.data(), &astrometry_->context);
}

SkyObserver::~SkyObserver() = default;

// Applies proper motion and parallax, the Sun's deflection of light, and aberration, as eraPmpx and eraAtciqz do, with
// vectors instead of angles.
Vec3 SkyObserver::apparent(const Star& star) const {
  const Vec3 position = astrometry_->position();
  // Add the Roemer delay: the light reaches the observer earlier or later than the barycentre.
  const double years = years_ + star.position.dot(position) * ERFA_AULT / ERFA_DAYSEC / ERFA_DJY;
  Vec3 natural =
      (star.position + years * star.motion_rad_yr.cast<double>() - static_cast<double>(star.parallax_rad) * position)
          .normalized();
  eraLdsun(natural.data(), astrometry_->context.eh, astrometry_->context.em, natural.data());
  return astrometry_->aberrated(natural);
}

ApparentBody SkyObserver::body_at(const Vec3& from_observer_au, const Vec3& from_sun_au) const {
  ApparentBody body;
  body.from_observer = from_observer_au.normalized();
  body.direction = astrometry_->aberrated(body.from_observer);
  body.distance_m = from_observer_au.norm() * ERFA_DAU;
  body.sun_distance_m = from_sun_au.norm() * ERFA_DAU;
  if (body.sun_distance_m == 0) return body;
  body.from_sun = from_sun_au.normalized();
  body.phase_deg = angle_between(body.from_sun, body.from_observer) * kDegreesPerRadian;
  return body;
}

Mat3 SkyObserver::earth_from_icrf(double distance_m) const {
  const JulianDate tt{date_.day, date_.fraction - distance_m / ERFA_CMPS / ERFA_DAYSEC};
  JulianDate tai, utc;
  eraTttai(tt.day, tt.fraction, &tai.day, &tai.fraction);
  eraTaiutc(tai.day, tai.fraction, &utc.day, &utc.fraction);
  ErfaRotation rotation;
  eraC2t00b(tt.day, tt.fraction, utc.day, utc.fraction, 0, 0, rotation.rows);
  return rotation.matrix();
}

// Returns the vector from the observer to a body, au, when the light left that arrives; empty without a state of it.
// The light to the observer leaves earlier than that to the Moon's centre if its way is longer.
std::optional<Vec3> SkyObserver::from_observer_by_state(std::string_view name) const {
  const auto found = states_.find(name);
  if (found == states_.end()) return std::nullopt;
  const auto& [position_m, velocity_m_s] = found->second;
  const Vec3 offset_m = position_m - from_moon_m_;
  const double earlier_s = (offset_m.norm() - position_m.norm()) / ERFA_CMPS;
  return (offset_m - earlier_s * (velocity_m_s + moon_velocity_m_s_)) / ERFA_DAU;
}

ApparentBody SkyObserver::planet_by_state(const Vec3& from_observer_au) const {
  const Vec3 sun =
      earth_motion(date_, from_observer_au.norm() * kLightDaysPerAu).sun_from_barycentre() - astrometry_->position();
  ApparentBody body = body_at(from_observer_au, from_observer_au - sun);
  const eraASTROM& context = astrometry_->context;
  constexpr double kMinDeflectionAngle = 1e-6;  // as eraLdsun
  Vec3 natural;
  eraLd(1, body.from_observer.data(), body.from_sun.data(), const_cast<double*>(context.eh), context.em,
        kMinDeflectionAngle, natural.data());
  body.direction = astrometry_->aberrated(natural);
  return body;
}

ApparentBody SkyObserver::sun() const {
  if (const auto from_observer = from_observer_by_state("sun")) return body_at(*from_observer, Vec3::zero());
  const Vec3 position = at_departure(astrometry_->position(),
                                     [&](double days) { return earth_motion(date_, days).sun_from_barycentre(); });
  return body_at(position - astrometry_->position(), Vec3::zero());
}

ApparentBody SkyObserver::planet(Planet planet) const {
  if (const auto from_observer = from_observer_by_state(planet_name(planet))) return planet_by_state(*from_observer);
  Vec3 from_sun;
  // One pass suffices for planets: the error of the light time then moves them by at most 0.01 arcsec, and VSOP87 takes
  // 0.15 ms per evaluation.
  const int passes = planet == Planet::earth ? 4 : 1;
  const Vec3 position = at_departure(
      astrometry_->position(),
      [&](double days) -> Vec3 {
        from_sun = planet_from_sun(planet, date_, days);
        return earth_motion(date_, days).sun_from_barycentre() + from_sun;
      },
      passes);
  return body_at(position - astrometry_->position(), from_sun);
}

}  // namespace selenograph::engine
