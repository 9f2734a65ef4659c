#include "engine/sky/ephemeris.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "dem/base/error.h"
#include "dem/grid/geodesy.h"

namespace selenograph::engine {
namespace {

constexpr double kRadPerDeg = 0.017453292519943295;

Geographic subsolar_point(const std::string& utc) { return to_geographic(sun_at(utc).direction * kMoonRadius_m); }

struct LocalSun {
  double azimuth_deg, elevation_deg;
};

LocalSun sun_over(double lat_deg, double lon_deg, const std::string& utc) {
  const EastNorthUp axes = local_axes(to_cartesian({lat_deg, lon_deg, 0}));
  const Vec3 sun = sun_at(utc).direction;
  return {std::atan2(sun.dot(axes.east), sun.dot(axes.north)) / kRadPerDeg, std::asin(sun.dot(axes.up)) / kRadPerDeg};
}

std::string complaint_about(const std::string& utc) {
  try {
    sun_at(utc);
  } catch (const ImpossibleRequest& e) {
    return e.what();
  }
  return "accepted";
}

// NASA's Scientific Visualization Studio, "Moon Phase and Libration" (Dial-A-Moon), computed with DE421 and its
// MOON_ME, three decimals.
TEST(SunAt, AgreesWithDe421WithinTheStatedAccuracy) {
  const struct {
    const char* utc;
    double lon_deg, lat_deg;
  } published[] = {{"2024-01-01T00:00:00Z", -55.867, -1.554},
                   {"2025-06-30T23:00:00Z", 116.296, 1.473},
                   {"2026-01-01T00:00:00Z", 32.520, -1.346}};
  for (const auto& p : published) {
    const Geographic g = subsolar_point(p.utc);
    EXPECT_NEAR(g.lon_deg, p.lon_deg, 0.005) << p.utc;
    EXPECT_NEAR(g.lat_deg, p.lat_deg, 0.005) << p.utc;
  }
}

// Meeus, "Astronomical Algorithms", example 53.a: 1992 April 12, 0h TD: l0 = 67.89, b0 = +1.46 (colongitude 22.11). His
// series are shorter: 0.02 degrees.
TEST(SunAt, AgreesWithMeeus) {
  const Geographic g = subsolar_point("1992-04-11T23:59:00.816Z");  // TD - UTC = 59.184 s
  EXPECT_NEAR(g.lon_deg, 67.89, 0.02);
  EXPECT_NEAR(g.lat_deg, 1.46, 0.02);
}

// The Sun was 10.8 degrees high in the east when Apollo 11 landed.
TEST(SunAt, StandsWhereApollo11SawIt) {
  const LocalSun sun = sun_over(0.674, 23.473, "1969-07-20T20:17:40Z");
  EXPECT_NEAR(sun.elevation_deg, 10.8, 0.2);
  EXPECT_NEAR(sun.azimuth_deg, 90.0, 2.0);
}

TEST(SunAt, SubsolarLatitudeStaysWithinTheObliquity) {
  double largest_deg = 0;
  for (int year = 1960; year <= 2099; ++year) {
    for (int month = 1; month <= 12; ++month) {
      char utc[64];
      std::snprintf(utc, sizeof utc, "%04d-%02d-15T12:00:00Z", year, month);
      largest_deg = std::max(largest_deg, std::abs(subsolar_point(utc).lat_deg));
    }
  }
  EXPECT_LT(largest_deg, 1.62);
  EXPECT_GT(largest_deg, 1.5);
}

// Perihelion 2026 is 0.983302 au from the Earth's centre; the Moon is full then, 0.00242 au farther out.
TEST(SunAt, DistanceIsThatOfTheMoon) { EXPECT_NEAR(sun_at("2026-01-03T12:00:00Z").distance_au, 0.98572, 2e-5); }

TEST(SunAt, DirectionIsAUnitVectorAndMovesWithFractionsOfASecond) {
  const Vec3 now = sun_at("2026-11-20T00:00:00Z").direction;
  const Vec3 later = sun_at("2026-11-20T00:00:00.75Z").direction;
  EXPECT_NEAR(now.norm(), 1.0, 1e-15);
  // 360 degrees in a synodic month: 2.46e-6 rad/s.
  EXPECT_NEAR((later - now).norm(), 0.75 * 2.46e-6, 0.1e-6);
  EXPECT_EQ(now, sun_at("2026-11-20T00:00:00").direction);
  EXPECT_EQ(now, sun_at("2026-11-20T00:00:00+00:00").direction);
}

TEST(SunAt, LeapSecondsAreSecondsOfTheirOwn) {
  const Vec3 before = sun_at("2016-12-31T23:59:59Z").direction;
  const Vec3 leap = sun_at("2016-12-31T23:59:60Z").direction;
  const Vec3 after = sun_at("2017-01-01T00:00:00Z").direction;
  EXPECT_NEAR((leap - before).norm(), 2.46e-6, 0.1e-6);
  EXPECT_NEAR((after - leap).norm(), 2.46e-6, 0.1e-6);
}

TEST(SunAt, KnowsDaysOfTheYear) {
  EXPECT_EQ(sun_at("2026-324T06:30:00.25").direction, sun_at("2026-11-20T06:30:00.25Z").direction);
  EXPECT_EQ(sun_at("2026-001T00:00:00Z").direction, sun_at("2026-01-01T00:00:00Z").direction);
  EXPECT_EQ(sun_at("2028-060T00:00:00Z").direction, sun_at("2028-02-29T00:00:00Z").direction);
  EXPECT_EQ(sun_at("2016-366T23:59:60Z").direction, sun_at("2016-12-31T23:59:60Z").direction);
}

// NAIF's str2et is within 30 microseconds of ERFA: it has one term of the difference between TDB and TT.
TEST(UtcOfEt, AgreesWithSpice) {
  const struct {
    double et_s;
    const char* minute;
    double second;
  } cases[] = {
      {0, "2000-01-01T11:58:", 55.816072737},
      // Half a minute after two that NAIF prints, so that rounding doesn't change the minute.
      {64.183927284731055 + 30, "2000-01-01T12:00:", 30},  // "Time Required Reading"
      {140254384.184625 + 30, "2004-06-11T19:32:", 30},    // lesson "Remote Sensing"
      {536500868.684, "2016-12-31T23:59:", 60.5},          // in a leap second; TDB is TT here to 0.1 ms
  };
  for (const auto& c : cases) {
    const std::string utc = utc_of_et(c.et_s);
    EXPECT_EQ(utc.size(), 27u) << utc;
    EXPECT_EQ(utc.substr(0, 17), c.minute) << utc;
    EXPECT_NEAR(std::stod(utc.substr(17)), c.second, 2e-4) << utc;
  }
  for (const double et_s : {-1.3e9, 3.2e9, 1e300, -1e300, std::nan("")})
    EXPECT_THROW(utc_of_et(et_s), ImpossibleRequest) << et_s;
  EXPECT_EQ(utc_of_et(3155716800.0 + 69.184 - 1).substr(0, 19), "2099-12-31T23:59:59");
}

TEST(SunAt, RejectsInvalidEpochs) {
  const struct {
    const char *utc, *complaint;
  } cases[] = {
      {"", "expected YYYY"},
      {"2026-11-20", "expected YYYY"},
      {"2026-11-20 00:00:00Z", "expected YYYY"},
      {"2026-11-20T00:00Z", "expected YYYY"},
      {"2026-11-20T00:00:00.Z", "expected YYYY"},
      {"2026-11-20T00:00:00ZZ", "expected YYYY"},
      {"+026-11-20T00:00:00Z", "expected YYYY"},
      {"2026-11-20T00:00:-1Z", "expected YYYY"},
      {"2026-00-20T00:00:00Z", "month"},
      {"2026-13-20T00:00:00Z", "month"},
      {"2026-02-30T00:00:00Z", "no such day"},
      {"2025-02-29T00:00:00Z", "no such day"},
      {"2026-11-20T25:00:00Z", "hour"},
      {"2026-11-20T24:00:00Z", "hour"},
      {"2026-11-20T00:60:00Z", "minute"},
      {"2026-11-20T00:00:60Z", "leap second"},
      {"2017-12-31T23:59:60Z", "leap second"},
      {"2016-12-31T23:59:61Z", "second"},
      {"2026-11-20T09:00:00+09:00", "offset"},
      {"2026-11-20T00:00:00-00:00", "offset"},
      {"2026-11-20T00:00:00+00:00Z", "offset"},
      {"2026-11-20T00:01:09.184 TDB", "et_s"},
      {"2026-11-20T00:01:09.184TT", "et_s"},
      {"2026-000T00:00:00Z", "no such day"},
      {"2026-366T00:00:00Z", "no such day"},
      {"2026-32T00:00:00Z", "expected YYYY"},
      {"2026-3240T00:00:00Z", "expected YYYY"},
      {"1959-12-31T00:00:00Z", "1960 to 2099"},
      {"2100-01-01T00:00:00Z", "1960 to 2099"},
  };
  for (const auto& c : cases) {
    const std::string complaint = complaint_about(c.utc);
    EXPECT_NE(complaint.find(c.complaint), std::string::npos) << c.utc << ": " << complaint;
    EXPECT_NE(complaint.find(c.utc), std::string::npos) << complaint;
  }
  EXPECT_LT(complaint_about(std::string(100000, '7')).size(), 200u);
  EXPECT_EQ(complaint_about("2028-02-29T00:00:00Z"), "accepted");
  EXPECT_EQ(complaint_about("2028-366T00:00:00Z"), "accepted");
  EXPECT_EQ(complaint_about("1960-01-01T00:00:00Z"), "accepted");
  EXPECT_EQ(complaint_about("2099-12-31T23:59:59.999999Z"), "accepted");
}

// Laser retroreflectors of Apollo 11 and 15: principal axes coordinates from laser ranging (DE440) against mean Earth
// coordinates as seen on LRO images. A wrong sign of a large angle misses by 0.04 degrees.
TEST(MoonMeFrom, PutsTheRetroreflectorsWhereLroSeesThem) {
  const struct {
    Vec3 pa_m;
    double lat_deg, lon_deg;
  } reflectors[] = {{{1591967.049, 690698.573, 21004.461}, 0.6735, 23.4731},
                    {{1554678.104, 98094.498, 765005.863}, 26.1334, 3.6285}};
  for (const auto& r : reflectors) {
    for (const BodyFrame frame : {BodyFrame::moon_pa_de421, BodyFrame::moon_pa_de440}) {
      const Geographic g = to_geographic(moon_me_from(frame) * r.pa_m);
      EXPECT_NEAR(g.lat_deg, r.lat_deg, 0.0003);
      EXPECT_NEAR(g.lon_deg, r.lon_deg, 0.0003);
    }
  }
}

TEST(MoonMeFrom, IsARotationThatMovesTheSurfaceBy860Metres) {
  for (const BodyFrame frame : {BodyFrame::moon_pa_de421, BodyFrame::moon_pa_de440}) {
    const Mat3 m = moon_me_from(frame);
    EXPECT_LE((m * m.transpose() - Mat3::identity()).max_abs(), 1e-15);
    EXPECT_NEAR(m.determinant(), 1.0, 1e-15);
    // Largest anywhere: the whole angle, sqrt(67.92^2 + 78.56^2 + 0.30^2) arcsec = 103.85 arcsec.
    EXPECT_NEAR(AngleAxis(m).angle_rad * kMoonRadius_m, 875.0, 2.0);
    // Longitude at the prime meridian's equator point: 67.9 arcsec eastwards.
    EXPECT_NEAR((m * Vec3(kMoonRadius_m, 0, 0)).y(), 572.0, 1.0);
    // +X leans south by 78.6 arcsec: mean Earth stands north of the long axis.
    EXPECT_NEAR((m * Vec3(kMoonRadius_m, 0, 0)).z(), -662.0, 1.0);
  }
  EXPECT_EQ(moon_me_from(BodyFrame::moon_me), Mat3::identity());
}

TEST(MoonMeFrom, Realisations421And440AgreeWithinTwoMetres) {
  const Mat3 apart = moon_me_from(BodyFrame::moon_pa_de421) * moon_me_from(BodyFrame::moon_pa_de440).transpose();
  const double apart_m = AngleAxis(apart).angle_rad * kMoonRadius_m;
  EXPECT_GT(apart_m, 0.5);
  EXPECT_LT(apart_m, 2.0);
}

}  // namespace
}  // namespace selenograph::engine
