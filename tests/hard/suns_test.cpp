// Suns where formulas have their corners: in the zenith, at a pole, on the horizon and below it.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <string>

#include "dem/grid/lattice.h"
#include "engine/radiometry/photometry.h"
#include "tests/support/frame_judge.h"
#include "tests/support/hard_views.h"
#include "tests/support/moon_without_relief.h"
#include "tests/support/reflectance.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {
namespace {

using engine::Frame;
using engine::FrameRequest;

// ---- a sphere without relief ---------------------------------------------------------------------------------------

class SmoothMoonUnder : public MoonWithoutRelief {
 protected:
  // A facet's own normal is up to half a post's angle off the sphere's: within that of the terminator it decides.
  static double post_rad() { return dem::post_spacing_m(8) / kMoonRadius_m; }

  struct Light {
    std::size_t lit = 0, dark = 0, near_terminator = 0;
    double worst_radiance = 0;  // W m-2 sr-1, against the formula
  };

  // Each pixel against the sphere: lit by day, dark by night, radiance equal to the formula.
  static Light expect_formula(const FrameRequest& request) {
    const Frame frame = renderer().render(request);
    Light light;
    EXPECT_EQ(frame.report.hit_fraction, 1);
    for (std::size_t i = 0; i < frame.products.lit.size(); ++i) {
      const Vec3 point = at3(frame.products.position, i), up = point.normalized();
      const double mu0 = up.dot(request.sun.direction), mu = up.dot((request.pose.position_m - point).normalized()),
                   radiance = static_cast<double>(frame.products.radiance[i]);
      const double expected = test::direct_radiance(request.reflectance, engine::kSolarConstant_w_m2, mu0, mu, 1);
      EXPECT_TRUE(std::isfinite(radiance) && radiance >= 0) << "pixel " << i;
      ++(frame.products.lit[i] > 0 ? light.lit : light.dark);
      if (std::abs(mu0) < post_rad()) {
        ++light.near_terminator;
        // Dark, or as bright as a place within a post may be.
        EXPECT_LE(radiance,
                  test::direct_radiance(request.reflectance, engine::kSolarConstant_w_m2, mu0 + post_rad(), mu, 1));
        continue;
      }
      EXPECT_EQ(frame.products.lit[i], mu0 > 0 ? 1.F : 0.F) << "pixel " << i;
      if (mu0 < 0) {
        EXPECT_EQ(frame.products.radiance[i], 0.F);
      }
      light.worst_radiance = std::max(light.worst_radiance, std::abs(radiance - expected));
    }
    // `normal` is float: 6e-8 of the cosines, of at most 26 W m-2 sr-1. Between posts normals are weighted means of
    // neighbours', 1e-8 short of the sphere's curvature.
    EXPECT_LT(light.worst_radiance, 1e-4);
    return light;
  }

  static void print(const std::string& name, const Light& light) {
    fmt::print("{:<34} lit {:5} dark {:5} within a post of the terminator {:4}  radiance off by {:.1e} W m-2 sr-1\n",
               name, light.lit, light.dark, light.near_terminator, light.worst_radiance);
  }
};

TEST_F(SmoothMoonUnder, ASunInTheZenith) {
  for (const Geographic& place :
       {Geographic{0, 0, 20000}, {37, 120, 20000}, {-89.999, 30, 20000}, {90, 0, 20000}, {0, 180, 2}}) {
    const Light light = expect_formula(nadir_view(place, 65, 50, to_cartesian(place).normalized()));
    EXPECT_EQ(light.dark, 0u);
    print(fmt::format("zenith over {} {}", place.lat_deg, place.lon_deg), light);
  }
}

TEST_F(SmoothMoonUnder, ASunOverAPole) {
  for (const double north : {1.0, -1.0}) {
    const Vec3 sun(0, 0, north);
    const Light day = expect_formula(nadir_view({90 * north, 0, 20000}, 65, 50, sun)),
                night = expect_formula(nadir_view({-90 * north, 0, 20000}, 65, 50, sun)),
                equator = expect_formula(nadir_view({0, 77, 200000}, 65, 50, sun));
    EXPECT_EQ(day.dark, 0u);
    EXPECT_EQ(night.lit, 0u);
    EXPECT_GT(equator.near_terminator, 0u);
    // The terminator is the equator, which is the image's middle row.
    EXPECT_NEAR(static_cast<double>(equator.lit), 65 * 32.5, 65.0);
    print("sub-solar pole", day), print("the other pole", night), print("the equator", equator);
  }
}

TEST_F(SmoothMoonUnder, ASunBelowTheHorizon) {
  const Geographic place{12, -140, 20000};
  for (const double elevation : {-0.01, -1.0, -10.0, -45.0, -90.0}) {
    const Light light = expect_formula(nadir_view(place, 65, 50, local_direction(to_cartesian(place), 200, elevation)));
    // 9 km are 0.3 degrees.
    if (elevation <= -1) {
      EXPECT_EQ(light.lit, 0u);
    }
    print(fmt::format("{} degrees below the horizon", -elevation), light);
  }
}

// mu0 = 0, as exactly as it can be: the terminator runs through the centres of the middle row or column of pixels.
TEST_F(SmoothMoonUnder, ASunExactlyOnTheHorizon) {
  struct Case {
    const char* name;
    Geographic place;
    Vec3 sun;
    bool along_row;
  };
  for (const Case& c : {Case{"north, seen from the equator", {0, 0, 20000}, Vec3::unit_z(), true},
                        Case{"south, seen from the equator", {0, 90, 20000}, -Vec3::unit_z(), true},
                        Case{"east", {0, 0, 20000}, Vec3::unit_y(), false},
                        Case{"west, at 180 degrees", {0, 180, 20000}, Vec3::unit_y(), false},
                        Case{"at the north pole", {90, 0, 20000}, Vec3::unit_y(), false}}) {
    SCOPED_TRACE(c.name);
    const FrameRequest request = nadir_view(c.place, 65, 50, c.sun);
    print(fmt::format("Sun on the horizon, {}", c.name), expect_formula(request));
    const Frame frame = renderer().render(request);
    double brightest = 0;
    for (std::size_t k = 0; k < 65; ++k) {
      const std::size_t i = c.along_row ? 32 * 65 + k : k * 65 + 32;
      ASSERT_NEAR(at3(frame.products.position, i).dot(c.sun), 0, 1e-6);
      brightest = std::max(brightest, static_cast<double>(frame.products.radiance[i]));
    }
    // mu0 itself is what float leaves of zero: 1e-7 of E rho / 2 pi.
    EXPECT_LT(brightest, 1e-5);
  }
}

// The place where coordinates are smallest: the scene's anchor itself (a multiple of 4096 m in x, y and z), where it
// happens to lie on the surface. What float leaves open there is not a share of the point's coordinates but of its
// triangle's.
TEST_F(SmoothMoonUnder, NextToTheAnchor) {
  constexpr double kLattice_m = 4096;
  std::size_t places = 0, pixels = 0;
  for (double x = 20 * kLattice_m; x < 400 * kLattice_m && places < 6; x += kLattice_m)
    for (double y = 3 * kLattice_m; y < 100 * kLattice_m && places < 6; y += kLattice_m) {
      const double z2 = kMoonRadius_m * kMoonRadius_m - x * x - y * y;
      if (z2 <= 0) continue;
      const Vec3 anchor(x, y, std::round(std::sqrt(z2) / kLattice_m) * kLattice_m);
      if (std::abs(anchor.norm() - kMoonRadius_m) > 2) continue;
      ++places;
      Geographic above = to_geographic(anchor);
      above.height_m = 60;
      for (const double elevation : {1.0, 10.0, 35.0, 60.0, 89.0}) {
        const Light light =
            expect_formula(nadir_view(above, 65, 30, local_direction(anchor, 37 * elevation, elevation)));
        EXPECT_EQ(light.dark, 0u) << "a flat place has no shadow";
        pixels += light.lit;
      }
    }
  fmt::print("{} places beside their anchor: {} pixels, all lit\n", places, pixels);
  EXPECT_EQ(places, 6u);
}

// ---- relief --------------------------------------------------------------------------------------------------------

class CragsUnder : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    write_kaguya_tile(folder_->path(), 1, 29, 2, 256, crags);
    scenery_ = new Scenery(folder_->path());
  }
  static void TearDownTestSuite() {
    delete scenery_;
    delete folder_;
    scenery_ = nullptr, folder_ = nullptr;
  }
  static Findings expect_judged(const std::string& name, const FrameRequest& request) {
    SCOPED_TRACE(name);
    const Findings found = judged(*scenery_->judge, request, scenery_->renderer->render(request));
    report(name, found);
    EXPECT_EQ(found.off_ray + found.off_terrain + found.unexplained, 0u);
    // A ray that goes into the ground within the rounding of its start (centimetres) is found out where it comes out
    // again. Under a Sun below the horizon it doesn't.
    EXPECT_LE(found.wrong, request.sun.direction.dot(request.pose.position_m) < 0 ? 1u : 0u);
    return found;
  }
  static inline TemporaryFolder* folder_ = nullptr;
  static inline Scenery* scenery_ = nullptr;
};

TEST_F(CragsUnder, ASunInTheZenithLeavesNoShadow) {
  const Geographic place{0, 30, 20000};
  const Findings found =
      expect_judged("crags, Sun in the zenith", nadir_view(place, 96, 50, to_cartesian(place).normalized()));
  EXPECT_EQ(found.lit, found.hits) << "no slope is as steep as the Sun is high";
}

TEST_F(CragsUnder, ASunOnTheHorizonAndALittleBelow) {
  const Geographic place{0, 30, 20000};
  for (const double elevation : {1.0, 0.0, -0.5})
    expect_judged(fmt::format("crags, Sun at {} deg", elevation),
                  nadir_view(place, 96, 50, local_direction(to_cartesian(place), 70, elevation)));
}

// Regional data under a Sun below the horizon. Where there are data they shade each other; outside of them nothing
// does but the solid Moon beneath all relief (12 km below the datum, seen 6.7 degrees below the horizon). So slopes
// beside the rim that face the Sun are lit down to there, as the judge has it too, and none below.
TEST_F(CragsUnder, ASunFarBelowTheHorizonAtTheRimOfTheData) {
  const Geographic inside{0, 30, 20000}, rim{0, 30.9, 20000};
  for (const double elevation : {-2.0, -5.0}) {
    const Vec3 at_rim = to_cartesian(rim);
    const Findings middle = expect_judged(fmt::format("crags, Sun at {} deg, inside", elevation),
                                          nadir_view(inside, 96, 50, local_direction(at_rim, 90, elevation))),
                   outermost = expect_judged(fmt::format("crags, Sun at {} deg, at the rim", elevation),
                                             nadir_view(rim, 96, 25, local_direction(at_rim, 90, elevation)));
    EXPECT_EQ(middle.lit, 0u);
    EXPECT_LT(outermost.lit * 10, outermost.hits);
  }
  for (const double elevation : {-7.5, -15.0, -30.0, -89.0}) {
    const FrameRequest request = nadir_view(rim, 96, 25, local_direction(to_cartesian(rim), 90, elevation));
    const Frame frame = scenery_->renderer->render(request);
    std::size_t lit = 0;
    for (std::size_t i = 0; i < frame.products.lit.size(); ++i)
      lit += frame.products.lit[i] > 0 || frame.products.radiance[i] != 0;
    EXPECT_EQ(lit, 0u) << elevation;
    EXPECT_GT(frame.report.hit_fraction, 0.8);
  }
}

}  // namespace
}  // namespace selenograph::test
