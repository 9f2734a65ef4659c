// Maps of a Moon without relief and of one with a wave: patches, bounds, progress.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/moon_without_relief.h"
#include "tests/support/queries.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

dem::MapGrid about(double lat_deg, double lon_deg, double gsd_m, int width, int height) {
  return {{dem::MapProjection::orthographic, lat_deg, lon_deg, 0},
          -width * gsd_m / 2,
          height * gsd_m / 2,
          gsd_m,
          width,
          height};
}

class LevelMap : public test::MoonWithoutRelief {};

TEST_F(LevelMap, EachPixelIsTheGroundBelowIt) {
  MapRequest request;
  request.grid = about(10, 20, 1000, 40, 30);
  request.products = kHeight | kNormal | kSlope | kSource;
  const Map map = test::render_map(renderer(), request);
  const dem::MapTransform map_of(request.grid.plane);
  ASSERT_EQ(map.products.height.size(), 1200U);
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x) {
      const auto at = static_cast<std::size_t>(40 * y + x);
      EXPECT_NEAR(map.products.height[at], 0, map.report.lod_error_m + test::kFinestSag_m);
      const float* n = &map.products.normal[3 * at];
      const Vec3 normal(static_cast<double>(n[0]), static_cast<double>(n[1]), static_cast<double>(n[2]));
      EXPECT_LT((normal - *map_of.direction(request.grid.point(x, y))).norm(), 1e-6);
      EXPECT_LT(map.products.slope[at], 1e-4);
      EXPECT_EQ(map.products.source[at], 0);
    }
  EXPECT_TRUE(map.products.radiance.empty());
  EXPECT_EQ(map.report.hit_fraction, 1);
  ASSERT_EQ(map.report.sources.size(), 1U);
  EXPECT_LE(map.report.lod_error_px, 0.5);
}

// Lambert: E mu0 rho / pi, whoever looks.
TEST_F(LevelMap, RadianceAndItsViewer) {
  MapRequest request;
  request.grid = about(10, 20, 1000, 16, 16);
  request.scenery.reflectance = {.model = ReflectanceModel::lambert, .rho = 0.3};
  const Vec3 up = to_cartesian({10, 20, 0}).normalized();
  const EastNorthUp axes = local_axes(up);
  request.scenery.sun.direction = (up + axes.east).normalized();
  for (const double lean : {0.0, 1.0, 5.0}) {
    request.toward_viewer = (up + lean * axes.north).normalized();
    for (const float radiance : test::render_map(renderer(), request).products.radiance)
      EXPECT_NEAR(static_cast<double>(radiance), 1361 * std::sqrt(0.5) * 0.3 / std::numbers::pi, 1.2);
  }
  request.toward_viewer = -up;  // from behind the Moon
  const Map hidden = test::render_map(renderer(), request);
  for (const float radiance : hidden.products.radiance) EXPECT_TRUE(std::isnan(radiance));
  EXPECT_EQ(hidden.report.hit_fraction, 1);
  EXPECT_FALSE(hidden.report.lit);
}

TEST_F(LevelMap, ProgressRisesToOneAndWorkStops) {
  MapRequest request;
  request.grid = about(0, 0, 100, 1100, 600);
  request.products = kHeight;
  std::vector<double> shares;
  test::render_map(renderer(), request, {}, [&](double share) { shares.push_back(share); });
  EXPECT_EQ(shares.size(), 6U);
  EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end()));
  EXPECT_EQ(shares.back(), 1);
  EXPECT_THROW(test::render_map(renderer(), request, StopToken(StopToken::Clock::now())), Cancelled);
}

double wave_m(double lat_deg, double lon_deg) {
  return 800 * std::sin(0.7 * lat_deg * 10) * std::cos(0.9 * lon_deg * 10);
}

// With little room for scenes a map is drawn in smaller patches: nothing else changes at the finest posts.
TEST(MapPatches, LittleMemoryMakesMorePatches) {
  const test::TemporaryFolder folder;
  test::write_float_tile(folder.path(), "wave", {2, 10, 64, 129, 129}, wave_m);
  const auto terrain = test::open_terrain(folder.path());
  const Renderer roomy(terrain, {1, std::size_t{1} << 30}), tight(terrain, {1, std::size_t{4} << 20});
  MapRequest request;
  request.grid = about(1, 11, 250, 120, 120);
  request.products = kHeight | kLit | kSource;
  request.scenery.accuracy.max_error_px = 0;
  const Vec3 up = to_cartesian({1, 11, 0}).normalized();
  request.scenery.sun.direction = (0.1 * up + local_axes(up).east).normalized();
  int patches = 0, smaller = 0;
  const Map whole = test::render_map(roomy, request, {}, [&](double) { ++patches; });
  const Map parts = test::render_map(tight, request, {}, [&](double) { ++smaller; });
  EXPECT_EQ(patches, 1);
  EXPECT_GT(smaller, 1);
  std::size_t dark = 0, differing = 0;
  for (std::size_t i = 0; i < whole.products.height.size(); ++i) {
    EXPECT_NEAR(whole.products.height[i], parts.products.height[i], 1e-6);
    dark += whole.products.lit[i] == 0, differing += whole.products.lit[i] != parts.products.lit[i];
  }
  EXPECT_GT(dark, 1000U);
  EXPECT_LT(differing, 20U);
  EXPECT_EQ(whole.products.source, parts.products.source);
}

TEST(MapPatches, OutsideTheDataIsNone) {
  const test::TemporaryFolder folder;
  test::write_float_tile(folder.path(), "wave", {2, 10, 64, 65, 65}, wave_m);
  const Renderer renderer(test::open_terrain(folder.path()), {1, std::size_t{256} << 20});
  MapRequest request;
  request.grid = {{dem::MapProjection::equirectangular, 0, 0, 0},
                  9 * kMetresPerDegree,
                  3 * kMetresPerDegree,
                  kMetresPerDegree / 10,
                  30,
                  30};
  request.products = kRadiance | kLit | kHeight | kSource;
  const Map map = test::render_map(renderer, request);
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 30; ++x) {
      const auto at = static_cast<std::size_t>(30 * y + x);
      const bool data = x >= 10 && x < 20 && y >= 10 && y < 20;
      EXPECT_EQ(std::isfinite(map.products.height[at]), data);
      EXPECT_EQ(std::isfinite(map.products.radiance[at]), data);
      EXPECT_EQ(std::isfinite(map.products.lit[at]), data);
      EXPECT_EQ(map.products.source[at], data ? 0 : 65535);
    }
  EXPECT_NEAR(map.report.missing_fraction, 800.0 / 900, 1e-12);
}

}  // namespace
}  // namespace selenograph::engine
