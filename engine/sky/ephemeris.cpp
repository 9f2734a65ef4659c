// Error budget of sun_at, as an angle at the Moon, 1960..2099:
//   lunar rotation    WGCCRE series against JPL's mean Earth frames: about 150 m on the surface in our time, 0.005 deg
//                     (why Archinal et al. 2018, the report for 2015, leaves it out); 299 m at most over 1550..2000,
//                     0.0099 deg (J. Irwin, SPICE discussion list, May 2015: against DE430)
//   Earth, eraEpv00   11.2 km at most against DE405, 1900..2100 (ERFA, note 4): 0.000004 deg
//   Moon, eraMoon98   31.7 km at most against ELP/MPP02, 1950..2100 (ERFA, note 3): 0.000012 deg
//   TDB taken as TT   2 ms of the Moon's turning: 0.0000003 deg
//   leap seconds      0.00014 deg for each one that is announced after ERFA's table was made
// In all 0.01 deg; 0.002 deg in the three epochs of DE421 that the tests know. Both ERFA theories answer in ICRS axes
// (BCRS and GCRS), to which the WGCCRE pole refers too.
#include "engine/sky/ephemeris.h"

#include <erfa.h>
#include <erfam.h>
#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <string_view>

#include "dem/base/error.h"
#include "dem/grid/rotation.h"
#include "engine/sky/erfa_rows.h"

namespace selenograph::engine {
namespace {

constexpr double kRadPerDeg = ERFA_DD2R;

// --- UTC -> TT

[[noreturn]] void reject(const std::string& utc, const std::string& why) {
  constexpr std::size_t kMaxEcho = 40;  // longer input is not repeated in the error message
  throw ImpossibleRequest("not a UTC epoch like 2026-11-20T00:00:00Z" +
                          (utc.size() <= kMaxEcho ? ": \"" + utc + "\"" : std::string()) + ": " + why);
}

struct DateTime {
  int year = 0, month = 0, day = 0, hour = 0, minute = 0;
  double second = 0;
};

// Takes exactly `count` digits from the front of `text`.
std::optional<int> take_digits(std::string_view& text, std::size_t count) {
  if (text.size() < count) return std::nullopt;
  int value = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (text[i] < '0' || text[i] > '9') return std::nullopt;
    value = 10 * value + (text[i] - '0');
  }
  text.remove_prefix(count);
  return value;
}

// Takes one character from the front of `text`; returns false if it is another one.
bool take(std::string_view& text, char c) {
  if (text.empty() || text.front() != c) return false;
  text.remove_prefix(1);
  return true;
}

// Takes the digits after the decimal point as a number below 1; empty if there are none.
std::optional<double> take_fraction(std::string_view& text) {
  double value = 0, unit = 0.1;
  std::size_t digits = 0;
  for (; digits < text.size() && text[digits] >= '0' && text[digits] <= '9'; ++digits, unit /= 10) {
    value += unit * (text[digits] - '0');
  }
  if (digits == 0) return std::nullopt;
  text.remove_prefix(digits);
  return value;
}

// Sets month and day from the day of the year, 1 to 366.
void set_day_of_year(const std::string& utc, int day_of_year, DateTime& t) {
  JulianDate new_year;
  int year = 0;
  double fraction = 0;
  eraCal2jd(t.year, 1, 1, &new_year.day, &new_year.fraction);
  eraJd2cal(new_year.day, new_year.fraction + day_of_year - 1, &year, &t.month, &t.day, &fraction);
  if (year != t.year) reject(utc, "this year has no such day");
}

// Returns whether the text after the seconds names a time scale other than UTC, as SPICE's texts do.
bool names_other_scale(std::string_view rest) {
  take(rest, ' ');
  return rest == "TDB" || rest == "ET" || rest == "TDT" || rest == "TT" || rest == "TAI";
}

// Reads a UTC epoch in one of the two forms that the message names; throws ImpossibleRequest for any other text.
DateTime parse(const std::string& utc) {
  const char* const form =
      "expected YYYY-MM-DDThh:mm:ss or YYYY-DDDThh:mm:ss, a fraction of a second or none, Z, +00:00 or none";
  std::string_view rest = utc;
  DateTime t;
  const auto read = [&](std::size_t digits, char separator) {
    const std::optional<int> value = take_digits(rest, digits);
    if (!value || !take(rest, separator)) reject(utc, form);
    return *value;
  };
  t.year = read(4, '-');
  if (rest.find('T') == 3) {  // three digits before T: the day of the year
    set_day_of_year(utc, read(3, 'T'), t);
  } else {
    t.month = read(2, '-');
    t.day = read(2, 'T');
  }
  t.hour = read(2, ':');
  t.minute = read(2, ':');
  const std::optional<int> second = take_digits(rest, 2);
  if (!second) reject(utc, form);
  t.second = *second;
  if (take(rest, '.')) {
    const std::optional<double> fraction = take_fraction(rest);
    if (!fraction) reject(utc, form);
    t.second += *fraction;
  }
  constexpr std::string_view kNoOffset = "+00:00";  // RFC 3339: the same as Z
  if (rest == kNoOffset) return t;
  if (!rest.empty() && (rest.front() == '+' || rest.front() == '-')) {
    reject(utc, "local time offsets are not accepted; convert to UTC and end with Z");
  }
  if (names_other_scale(rest)) reject(utc, "another time scale; give Ephemeris Time, seconds of TDB, as \"et_s\"");
  take(rest, 'Z');
  if (!rest.empty()) reject(utc, form);
  return t;
}

// Fills ERFA's leap second table. ERFA does that on first use without a lock; the static initialiser runs once, so that
// two request threads cannot race.
void load_leap_seconds() {
  [[maybe_unused]] static const int loaded = [] {
    double tai_minus_utc = 0;
    return eraDat(2000, 1, 1, 0.0, &tai_minus_utc);
  }();
}

// Returns the Julian date in UTC. A "dubious year" (after the end of the leap second table) is no error: the last leap
// second of the table then remains in force.
JulianDate utc_from(const std::string& utc, const DateTime& t) {
  // Before 1960 there was no UTC; past 2099 eraEpv00 is outside the range that it was fitted to.
  if (t.year < 1960 || t.year > 2099) reject(utc, "the year must be 1960 to 2099");
  JulianDate date;
  switch (eraDtf2d("UTC", t.year, t.month, t.day, t.hour, t.minute, t.second, &date.day, &date.fraction)) {
    case 0:
    case 1:
      return date;
    case 2:
    case 3:
      reject(utc, "the second must be below 60 (second 60 exists only where a leap second was inserted)");
    case -2:
      reject(utc, "the month must be 01 to 12");
    case -3:
      reject(utc, "this month has no such day");
    case -4:
      reject(utc, "the hour must be 00 to 23");
    case -5:
      reject(utc, "the minute must be 00 to 59");
    default:
      reject(utc, "no such date");
  }
}

// Returns the Julian date in UTC of one in TDB.
JulianDate utc_from_tdb(const JulianDate& tdb) {
  // Evaluate TDB - TT at the Earth's centre: on the surface it differs by at most 2 microseconds.
  const double tdb_minus_tt_s = eraDtdb(tdb.day, tdb.fraction, 0, 0, 0, 0);
  JulianDate tt, tai, utc;
  eraTdbtt(tdb.day, tdb.fraction, tdb_minus_tt_s, &tt.day, &tt.fraction);
  eraTttai(tt.day, tt.fraction, &tai.day, &tai.fraction);
  eraTaiutc(tai.day, tai.fraction, &utc.day, &utc.fraction);
  return utc;
}

// --- Sun and Moon

// Returns a passive rotation, the convention of this file's sources: the axes turn by the angle, the vector stays.
Mat3 axes_turned(double angle_rad, const Vec3& axis) { return AngleAxis(-angle_rad, axis).matrix(); }

// Returns the Moon's position and velocity relative to the Earth, ICRS axes, au and au per day.
PositionVelocity moon_from_earth(const JulianDate& tdb) {
  ErfaMotion motion;
  eraMoon98(tdb.day, tdb.fraction, motion.rows);
  return motion.motion();
}

// Returns the apparent Sun as seen from the Moon's centre, ICRS axes, au: light time first, then aberration.
Vec3 apparent_sun_icrs_au(const JulianDate& tdb) {
  ErfaMotion from_sun, from_barycentre;
  eraEpv00(tdb.day, tdb.fraction, from_sun.rows, from_barycentre.rows);
  const PositionVelocity sun_to_earth = from_sun.motion(), barycentre_to_earth = from_barycentre.motion(),
                         earth_to_moon = moon_from_earth(tdb);

  const Vec3 geometric = -(sun_to_earth + earth_to_moon).position;
  const Vec3 sun_velocity = (barycentre_to_earth - sun_to_earth).velocity;
  const Vec3 moon_velocity = (barycentre_to_earth + earth_to_moon).velocity;
  const double light_time_d = geometric.norm() * ERFA_AULT / ERFA_DAYSEC;
  const Vec3 retarded = geometric - sun_velocity * light_time_d;  // at most 6 km: one iteration suffices
  // Aberration to first order in v/c = 1e-4; the next order is 2 milliarcseconds.
  const double light_speed_au_per_day = ERFA_DAYSEC / ERFA_AULT;
  return (retarded.normalized() + moon_velocity / light_speed_au_per_day).normalized() * retarded.norm();
}

// Rotation of the Moon: Archinal et al. 2011, "Report of the IAU Working Group on Cartographic Coordinates and
// Rotational Elements: 2009", table 2. It realises the mean Earth / polar axis frame. Argument E = phase + rate d,
// degrees, d in days of TDB from J2000.0; right ascension and W take sin E, declination cos E.
struct LibrationTerm {
  double phase_deg, rate_deg_per_d, right_ascension_deg, declination_deg, prime_meridian_deg;
};
constexpr LibrationTerm kLibration[] = {
    {125.045, -0.0529921, -3.8787, 1.5419, 3.5610},
    {250.089, -0.1059842, -0.1204, 0.0239, 0.1208},
    {260.008, 13.0120009, 0.0700, -0.0278, -0.0642},
    {176.625, 13.3407154, -0.0172, 0.0068, 0.0158},
    {357.529, 0.9856003, 0, 0, 0.0252},
    {311.589, 26.4057084, 0.0072, -0.0029, -0.0066},
    {134.963, 13.0649930, 0, 0.0009, -0.0047},
    {276.617, 0.3287146, 0, 0, -0.0046},
    {34.226, 1.7484877, 0, 0, 0.0028},
    {15.134, -0.1589763, -0.0052, 0.0008, 0.0052},
    {119.743, 0.0036096, 0, 0, 0.0040},
    {239.961, 0.1643573, 0, 0, 0.0019},
    {25.053, 12.9590088, 0.0043, -0.0009, -0.0044},
};

// Returns the rotation from ICRS axes into MOON_ME: Rz(W) Rx(90 deg - declination) Rz(90 deg + right ascension).
Mat3 moon_me_from_icrs(const JulianDate& tdb) {
  const double d = (tdb.day - ERFA_DJ00) + tdb.fraction;
  const double centuries = d / ERFA_DJC;
  double right_ascension_deg = 269.9949 + 0.0031 * centuries;
  double declination_deg = 66.5392 + 0.0130 * centuries;
  double prime_meridian_deg = 38.3213 + 13.17635815 * d - 1.4e-12 * d * d;
  for (const LibrationTerm& term : kLibration) {
    const double argument = (term.phase_deg + term.rate_deg_per_d * d) * kRadPerDeg;
    right_ascension_deg += term.right_ascension_deg * std::sin(argument);
    declination_deg += term.declination_deg * std::cos(argument);
    prime_meridian_deg += term.prime_meridian_deg * std::sin(argument);
  }
  return axes_turned(prime_meridian_deg * kRadPerDeg, Vec3::unit_z()) *
         axes_turned((90.0 - declination_deg) * kRadPerDeg, Vec3::unit_x()) *
         axes_turned((90.0 + right_ascension_deg) * kRadPerDeg, Vec3::unit_z());
}

// Returns the rotation from principal axes into the mean Earth frame: ME = Rx(-x) Ry(-y) Rz(-z) PA.
Mat3 moon_me_from_pa(double x_arcsec, double y_arcsec, double z_arcsec) {
  return axes_turned(-x_arcsec * ERFA_DAS2R, Vec3::unit_x()) * axes_turned(-y_arcsec * ERFA_DAS2R, Vec3::unit_y()) *
         axes_turned(-z_arcsec * ERFA_DAS2R, Vec3::unit_z());
}

}  // namespace

JulianDate tt_at(const std::string& utc) {
  load_leap_seconds();
  const JulianDate date = utc_from(utc, parse(utc));
  JulianDate tai, tt;
  if (eraUtctai(date.day, date.fraction, &tai.day, &tai.fraction) < 0 ||
      eraTaitt(tai.day, tai.fraction, &tt.day, &tt.fraction) != 0) {
    reject(utc, "outside the range of the time scales");
  }
  return tt;
}

SunPosition sun_at(const std::string& utc) {
  const JulianDate tdb = tt_at(utc);  // neglects TDB - TT, at most 2 ms
  const Vec3 sun_au = apparent_sun_icrs_au(tdb);
  return {(moon_me_from_icrs(tdb) * sun_au).normalized(), sun_au.norm()};
}

Earth earth_at(const std::string& utc) {
  const JulianDate tdb = tt_at(utc);
  const PositionVelocity earth_to_moon = moon_from_earth(tdb);
  // The Earth and the Moon move together around the Sun. Aberration from their relative velocity remains: 3.4e-6.
  const double light_speed_au_per_day = ERFA_DAYSEC / ERFA_AULT;
  const Vec3 toward = -earth_to_moon.position, velocity = earth_to_moon.velocity;
  const Vec3 apparent = toward.normalized() + velocity / light_speed_au_per_day;
  return {(moon_me_from_icrs(tdb) * apparent).normalized(), toward.norm() * ERFA_DAU};
}

Mat3 moon_me_from_icrf(const std::string& utc, double later_s) {
  const JulianDate tdb = tt_at(utc);
  return moon_me_from_icrs({tdb.day, tdb.fraction + later_s / ERFA_DAYSEC});
}

std::string utc_of_et(double et_s) {
  load_leap_seconds();
  const double days = std::floor(et_s / ERFA_DAYSEC);
  int year = 0, month = 0, day = 0;
  int time[4] = {};  // hour, minute, second, microseconds
  // Convert only days that ERFA can handle: a larger number leaves year 0, which is refused below.
  if (std::abs(days) < 1e6) {
    const JulianDate utc = utc_from_tdb({ERFA_DJ00 + days, (et_s - days * ERFA_DAYSEC) / ERFA_DAYSEC});
    // Round to microseconds: a double resolves present-day values of et_s to 0.1 microseconds.
    eraD2dtf("UTC", 6, utc.day, utc.fraction, &year, &month, &day, time);
  }
  if (year < 1960 || year > 2099)
    throw ImpossibleRequest("not an epoch of 1960 to 2099, in seconds of TDB since 2000-01-01T12:00:00");
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:06}Z", year, month, day, time[0], time[1], time[2],
                     time[3]);
}

Mat3 moon_me_from(BodyFrame frame) {
  switch (frame) {
    // Williams, Boggs and Folkner 2008, "DE421 Lunar Orbit, Physical Librations, and Surface Coordinates", JPL IOM
    // 335-JW,DB,WF-20080314-001; the same angles stand in NAIF's moon_080317.tf.
    case BodyFrame::moon_pa_de421:
      return moon_me_from_pa(0.30, 78.56, 67.92);
    // Park et al. 2021, "The JPL Planetary and Lunar Ephemerides DE440 and DE441", AJ 161:105: from DE440's principal
    // axes to DE421's mean Earth frame; the same angles stand in NAIF's moon_de440_200625.tf.
    case BodyFrame::moon_pa_de440:
      return moon_me_from_pa(0.2785, 78.6944, 67.8526);
    case BodyFrame::moon_me:
      break;
  }
  return Mat3::identity();
}

}  // namespace selenograph::engine
