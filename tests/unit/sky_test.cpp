// Stars and bodies as they appear: catalogue, places, brightness.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "dem/base/error.h"
#include "engine/frame/sun.h"
#include "engine/sky/earth_figure.h"
#include "engine/sky/ephemeris.h"
#include "engine/sky/magnitudes.h"
#include "engine/sky/sky_observer.h"
#include "engine/sky/star_catalogue.h"
#include "tests/support/de431_planets.h"
#include "tests/support/shared_data.h"
#include "tests/support/vec_text.h"

namespace selenograph::engine {
namespace {

constexpr double kArcsec = std::numbers::pi / 180 / 3600;
constexpr const char* kHead = "id,ra_deg,dec_deg,epoch_yr,pm_ra_mas_yr,pm_dec_mas_yr,parallax_mas,v_mag,b_v\n";

std::string complaint_about_stars(const std::string& text) {
  const test::TemporaryFolder folder;
  const std::string path = folder.path() + "/some.csv";
  std::ofstream(path) << text;
  try {
    StarCatalogue::read(path);
  } catch (const DataError& e) {
    return e.what();
  }
  return "accepted";
}

TEST(StarCatalogue, SaysFileAndLine) {
  const std::string good = "HR 1,10,20,2000,0,0,0,4.5,0.6\n";
  EXPECT_EQ(complaint_about_stars(kHead + good), "accepted");
  EXPECT_NE(complaint_about_stars("# of mine\n" + good).find("some.csv: line 2: the columns must be id,"),
            std::string::npos);
  EXPECT_NE(complaint_about_stars(kHead + good + "HR 2,10,x,2000,0,0,0,4.5,0.6\n").find("line 3: numbers"),
            std::string::npos);
  EXPECT_NE(complaint_about_stars(kHead + std::string("HR 2,10,20\n")).find("line 2: has 2 numbers"),
            std::string::npos);
  EXPECT_NE(complaint_about_stars(kHead + std::string("HR 2,10,-91,2000,0,0,0,4.5,0.6\n"))
                .find("line 2: dec_deg must be -90 to 90"),
            std::string::npos);
  EXPECT_NE(complaint_about_stars(kHead + std::string("H\xe9 2,10,20,2000,0,0,0,4.5,0.6\n"))
                .find("line 2: the identifier is not UTF-8"),
            std::string::npos);
  EXPECT_NE(complaint_about_stars(kHead).find("has no stars"), std::string::npos);
}

std::vector<StarRow> synthetic_stars(int count) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<StarRow> rows;
  for (int i = 0; i < count; ++i)
    rows.push_back({"S" + std::to_string(i), 360 * unit(random), std::asin(2 * unit(random) - 1) * kDegreesPerRadian,
                    2000, 0, 0, 0, 12 * unit(random), unit(random)});
  return rows;
}

TEST(StarCatalogue, FindsByFieldWhatALookAtEachStarFinds) {
  const std::vector<StarRow> rows = synthetic_stars(20000);
  const StarCatalogue catalogue("synthetic", rows);
  ASSERT_EQ(catalogue.size(), rows.size());
  for (const Vec3& towards : {Vec3(1, 0, 0), Vec3(-1, 0.01, 0.02), Vec3(0, 0, 1), Vec3(0.01, 0, -1), Vec3(1, -2, 3)})
    for (const double radius : {0.05, 0.5, 3.15}) {
      const Vec3 d = towards.normalized();
      std::vector<std::string> found, expected;
      for (const std::uint32_t i : catalogue.within(d, radius, 9)) found.emplace_back(catalogue.id(i));
      for (const StarRow& row : rows) {
        const double ra = row.ra_deg * kRadiansPerDegree, dec = row.dec_deg * kRadiansPerDegree;
        const Vec3 at(std::cos(dec) * std::cos(ra), std::cos(dec) * std::sin(ra), std::sin(dec));
        if (row.v_mag <= 9 && std::atan2(at.cross(d).norm(), at.dot(d)) <= radius) expected.push_back(row.id);
      }
      std::sort(found.begin(), found.end()), std::sort(expected.begin(), expected.end());
      EXPECT_EQ(found, expected) << towards << " within " << radius;
    }
}

TEST(StarCatalogue, ChangesItsFingerprintWithAnyRow) {
  std::vector<StarRow> rows = synthetic_stars(10);
  const std::uint64_t before = StarCatalogue("s", rows).fingerprint();
  EXPECT_EQ(StarCatalogue("s", rows).fingerprint(), before);
  rows[3].b_v += 0.1;
  EXPECT_NE(StarCatalogue("s", rows).fingerprint(), before);
}

Star star_at(double ra_deg, double dec_deg, double pm_ra = 0, double pm_dec = 0, double epoch_yr = 2000) {
  return StarCatalogue("one", {{"a", ra_deg, dec_deg, epoch_yr, pm_ra, pm_dec, 0, 5, 0.6}}).star(0);
}

// v / c sin(angle), to second order in v / c.
TEST(SkyObserver, MovesStarsTowardItsVelocity) {
  const std::string utc = "2026-11-25T00:00:00Z";
  const Vec3 velocity(0, 0, 3000);
  const SkyObserver at_rest(utc, Vec3::zero(), Vec3::zero()), moving(utc, Vec3::zero(), velocity);
  const Vec3 along = at_rest.moon_me_from_icrf().transpose() * velocity.normalized();
  for (const double ra_deg : {0.0, 77.0, 200.0}) {
    const Vec3 before = at_rest.apparent(star_at(ra_deg, 30)), after = moving.apparent(star_at(ra_deg, 30));
    const double from = std::atan2(before.cross(along).norm(), before.dot(along)),
                 to = std::atan2(after.cross(along).norm(), after.dot(along));
    EXPECT_NEAR(from - to, 3000 / 299792458.0 * std::sin(from), 3e-9);  // 0.6 milliarcsec
  }
}

TEST(SkyObserver, MovesStarsByTheirProperMotion) {
  const SkyObserver observer("2025-01-01T00:00:00Z", Vec3::zero(), Vec3::zero());
  const double years = observer.years_since_j2000();
  EXPECT_NEAR(years, 25.0, 0.002);
  const Vec3 still = observer.apparent(star_at(100, 20)), moved = observer.apparent(star_at(100, 20, 0, 4000)),
             later = observer.apparent(star_at(100, 20, 0, 4000, 2010));
  // Aberration is nearly the same; Roemer's 8 minutes are 0.06 milliarcsec.
  EXPECT_NEAR(std::atan2(still.cross(moved).norm(), still.dot(moved)) / kArcsec, 4 * years, 0.02);
  EXPECT_NEAR(std::atan2(still.cross(later).norm(), still.dot(later)) / kArcsec, 4 * (years - 10), 0.02);
}

TEST(SkyObserver, SeesSunAndEarthWhereTheEphemerisHasThem) {
  for (const char* utc : {"2001-02-03T04:05:06Z", "2026-11-25T00:00:00Z"}) {
    const SkyObserver observer(utc, Vec3::zero(), Vec3::zero());
    const SunPosition sun = sun_at(utc);
    const Earth earth = earth_at(utc);
    EXPECT_LT((observer.moon_me_from_icrf() * observer.sun().direction - sun.direction).norm(), 0.01 * kArcsec) << utc;
    EXPECT_NEAR(observer.sun().distance_m / kAstronomicalUnit_m, sun.distance_au, 1e-9);
    const ApparentBody body = observer.planet(Planet::earth);
    EXPECT_LT((observer.moon_me_from_icrf() * body.direction - earth.direction).norm(), 0.01 * kArcsec) << utc;
    // During 1.3 s of light the Earth goes 38 km on.
    EXPECT_NEAR(body.distance_m, earth.distance_m, 4e4);
  }
}

// From 100 000 km beside the Moon the Earth is elsewhere by the angle that the step is wide.
TEST(SkyObserver, SeesTheEarthFromWhereItIs) {
  const std::string utc = "2026-11-25T00:00:00Z";
  const SkyObserver centre(utc, Vec3::zero(), Vec3::zero());
  const ApparentBody from_centre = centre.planet(Planet::earth);
  const Vec3 toward = centre.moon_me_from_icrf() * from_centre.from_observer,
             step = 1e8 * toward.cross(Vec3::unit_z()).normalized();
  const ApparentBody aside = SkyObserver(utc, step, Vec3::zero()).planet(Planet::earth);
  EXPECT_NEAR(std::atan2(aside.from_observer.cross(from_centre.from_observer).norm(),
                         aside.from_observer.dot(from_centre.from_observer)),
              std::atan(1e8 / from_centre.distance_m), 5e-6);  // 0.04 s more of light are 1.3 km of the Earth's way
}

// States of the theories themselves, at the Moon's centre: from 100 000 km beside it they lead to the theories' places.
// Without the light time to there they would not.
TEST(SkyObserver, TakesStatesInPlaceOfItsTheories) {
  const std::string utc = "2026-11-25T00:01:00Z", before = "2026-11-25T00:00:00Z", after = "2026-11-25T00:02:00Z";
  const auto offset_m = [](const std::string& at, Planet planet) -> Vec3 {
    const ApparentBody body = SkyObserver(at, Vec3::zero(), Vec3::zero()).planet(planet);
    return body.distance_m * body.from_observer;
  };
  const Vec3 aside(3e7, -8e7, 5e7);
  const SkyObserver theories(utc, aside, Vec3::zero());
  for (const Planet planet : {Planet::venus, Planet::mars, Planet::earth}) {
    const std::string name(planet_name(planet));
    BodyState state{offset_m(utc, planet), (offset_m(after, planet) - offset_m(before, planet)) / 120};
    const ApparentBody expected = theories.planet(planet),
                       found = SkyObserver(utc, aside, Vec3::zero(), {{name, state}}).planet(planet);
    EXPECT_LT(angle_between(found.from_observer, expected.from_observer), 0.002 * kArcsec) << name;
    EXPECT_NEAR(found.distance_m / expected.distance_m, 1, 1e-8) << name;
    EXPECT_NEAR(found.phase_deg, expected.phase_deg, 1e-6) << name;
    const Vec3 without_light_time = state.position_m - theories.moon_me_from_icrf().transpose() * aside;
    EXPECT_GT(angle_between(without_light_time, expected.from_observer), 0.004 * kArcsec) << name;
    state.velocity_m_s = Vec3::zero();
    state.position_m += 1e-4 * state.position_m.norm() * state.position_m.cross(Vec3::unit_z()).normalized();
    const ApparentBody moved = SkyObserver(utc, aside, Vec3::zero(), {{name, state}}).planet(planet);
    EXPECT_GT(angle_between(moved.direction, expected.direction), 10 * kArcsec) << name;
  }
}

// Mallama & Hilton (2018): the values of their test files.
TEST(Magnitudes, AreThoseOfMallamaAndHilton) {
  const struct {
    Planet planet;
    double sun_au, observer_au, phase_deg, magnitude;
  } published[] = {{Planet::mercury, 0.310295423552, 1.32182643625754, 1.1677, -2.477},
                   {Planet::mercury, 0.413629222334, 0.92644808718613, 90.1662, 0.181},
                   {Planet::venus, 0.722722540169, 1.71607489554051, 1.3232, -3.917},
                   {Planet::venus, 0.721480714554, 0.37762511206278, 124.1348, -4.916},
                   {Planet::jupiter, 5.446231815414, 6.44985867459088, 0.2446, -1.667},
                   {Planet::jupiter, 4.957681473205, 3.95393078136013, 0.3431, -2.934}};
  for (const auto& p : published) {
    ApparentBody body;
    body.distance_m = p.observer_au * kAstronomicalUnit_m, body.sun_distance_m = p.sun_au * kAstronomicalUnit_m;
    body.phase_deg = p.phase_deg;
    EXPECT_NEAR(planet_magnitude(p.planet, body), p.magnitude, 0.001) << planet_name(p.planet);
  }
}

// What everybody saw: Venus and Jupiter beside each other on 1 March 2023, Saturn with open rings in 2017 (JPL
// Horizons).
TEST(Magnitudes, OfPlanetsAreThoseOfTheAlmanac) {
  const SkyObserver march("2023-03-01T00:00:00Z", Vec3::zero(), Vec3::zero()),
      june("2017-06-15T00:00:00Z", Vec3::zero(), Vec3::zero());
  EXPECT_NEAR(planet_magnitude(Planet::venus, march.planet(Planet::venus)), -3.95, 0.1);
  EXPECT_NEAR(planet_magnitude(Planet::jupiter, march.planet(Planet::jupiter)), -2.1, 0.1);
  EXPECT_NEAR(planet_magnitude(Planet::saturn, june.planet(Planet::saturn)), 0.0, 0.1);
  const Vec3 venus = march.planet(Planet::venus).direction, jupiter = march.planet(Planet::jupiter).direction;
  EXPECT_LT(std::atan2(venus.cross(jupiter).norm(), venus.dot(jupiter)) * kDegreesPerRadian, 1.6);
}

// Espenak & Meeus, Five Millennium Catalog of Lunar Eclipses, 2025 March 14: the penumbra from 03:57 to 10:00, the
// umbra from 05:10 to 08:48, all of the Moon in it from 06:26 to 07:31. Their shadow is larger than that of a solid
// Earth by 1 to 2 percent: less than three minutes at these times.
TEST(Eclipse, IsThatOfTheCatalogue) {
  const auto shares = [](const char* time) {
    const std::string utc = "2025-03-14T" + std::string(time) + "Z";
    const Vec3 toward_earth = earth_at(utc).direction, across = toward_earth.unit_orthogonal();
    double least = 1, most = 0;
    for (int i = 0; i < 72; ++i) {  // around the limb, as the Earth sees it
      const double turn = 2 * std::numbers::pi * i / 72;
      const Vec3 limb = std::cos(turn) * across + std::sin(turn) * toward_earth.cross(across);
      const double share = share_of_sun_covered(utc, kMoonRadius_m * limb);
      least = std::min(least, share), most = std::max(most, share);
    }
    return std::pair(least, most);
  };
  const std::pair none(0.0, 0.0), all(1.0, 1.0);
  EXPECT_EQ(shares("03:56:00"), none);
  EXPECT_GT(shares("04:04:00").second, 0);
  EXPECT_LT(shares("05:08:00").second, 1);
  EXPECT_EQ(shares("05:16:00").second, 1);
  EXPECT_LT(shares("06:24:00").first, 1);
  EXPECT_EQ(shares("06:32:00"), all);
  EXPECT_EQ(shares("07:25:00"), all);
  EXPECT_LT(shares("07:34:00").first, 1);
  EXPECT_EQ(shares("10:02:00"), none);
}

TEST(Starlight, HasTheZeroPointAtItsWavelengthForAnyColour) {
  const Band narrow(0.55, 0.001);
  const Starlight light(&narrow);
  for (const double b_v : {-0.3, 0.0, 0.65, 1.5, 2.0}) EXPECT_NEAR(light.of_star(0, b_v) / 3.63e-11, 1, 1e-4) << b_v;
  EXPECT_NEAR(light.of_star(5, 0.3) / light.of_star(0, 0.3), 0.01, 1e-12);
}

// Red stars are brighter in the red than blue ones of the same V: the ratio of blackbodies.
TEST(Starlight, HasTheColourOfItsTemperature) {
  EXPECT_NEAR(star_temperature_k(0.65), 5778, 5);
  const Band red(0.8, 0.001);
  const Starlight light(&red);
  const double b_v[] = {0.0, 1.4};
  double over_visual[2];
  for (int i = 0; i < 2; ++i) {
    const double x = 14387.77 / star_temperature_k(b_v[i]);
    over_visual[i] = std::pow(0.55 / 0.8, 5) * std::expm1(x / 0.55) / std::expm1(x / 0.8);
  }
  EXPECT_NEAR(light.of_star(0, b_v[1]) / light.of_star(0, b_v[0]), over_visual[1] / over_visual[0], 1e-4);
}

// The Sun's own magnitude gives the solar constant, to the 2 % of zero point and spectrum.
TEST(Starlight, GivesTheSunItsIrradiance) {
  EXPECT_NEAR(Starlight(nullptr).of_planet(sun_magnitude(kAstronomicalUnit_m)) / 1361, 1, 0.03);
}

TEST(Planets, AreWhereDe431HasThemWithinTheStatedBounds) {
  const std::array<double, 7> stated_arcsec = {0.1, 0.2, 0.5, 0.5, 0.5, 2, 3};
  std::array<double, 7> worst_arcsec{};
  for (const PlanetEpoch& epoch : kDe431Planets) {
    const SkyObserver observer(epoch.utc, Vec3::zero(), Vec3::zero());
    for (std::size_t i = 0; i < 7; ++i) {
      const Vec3 found = observer.planet(other_planets()[i]).from_observer;
      const double off_arcsec = angle_between(found, epoch.direction(i)) * kDegreesPerRadian * 3600;
      worst_arcsec[i] = std::max(worst_arcsec[i], off_arcsec);
    }
  }
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_LT(worst_arcsec[i], stated_arcsec[i]) << planet_name(other_planets()[i]);
    RecordProperty(std::string(planet_name(other_planets()[i])), std::to_string(worst_arcsec[i]));
  }
}

}  // namespace
}  // namespace selenograph::engine
