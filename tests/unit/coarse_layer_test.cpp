// Coarse layers: beneath a small area of fine posts what they cast onto these takes their own triangles; beside a pole
// their errors are bounded.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/queries.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

constexpr double kLat = 10.3, kLon = 20.4, kElevation_deg = 1.5, kSide_deg = 0.03125, kFine = 8192;  // 3.7 m

struct Site {
  // `coarse_posts`: per degree, 8 degrees around the fine posts; 0: nothing is around them.
  Site(double coarse_posts, const test::HeightFunction& coarse_m, const test::HeightFunction& fine_m) {
    test::write_float_tile(folder.path(), "fine", {kLat + kSide_deg / 2, kLon - kSide_deg / 2, kFine, 257, 257},
                           fine_m);
    if (coarse_posts > 0) {
      const auto posts = static_cast<int>(8 * coarse_posts) + 1;
      test::write_float_tile(folder.path(), "coarse", {14, 16, coarse_posts, posts, posts}, coarse_m);
    }
    terrain = test::open_terrain(folder.path());
    renderer = std::make_unique<Renderer>(terrain, RendererOptions{1, std::size_t{1} << 30});
  }
  Map lit(double azimuth_deg) const {
    constexpr int kPixels = 80;
    constexpr double kGsd_m = 10;
    MapRequest request;
    request.grid = {{dem::MapProjection::orthographic, kLat, kLon, 0},
                    -kPixels * kGsd_m / 2,
                    kPixels * kGsd_m / 2,
                    kGsd_m,
                    kPixels,
                    kPixels};
    request.scenery.sun = {sun_direction(local_axes(to_cartesian({kLat, kLon, 0})), azimuth_deg, kElevation_deg), 1, 0,
                           0};
    request.products = kLit;
    return test::render_map(*renderer, request);
  }
  test::TemporaryFolder folder;
  std::shared_ptr<dem::PyramidTerrain> terrain;
  std::unique_ptr<Renderer> renderer;
};

double waves_m(double lat, double lon) { return 3 * std::sin(900 * lat) * std::cos(700 * lon); }

TEST(CoarseLayer, TakesFewTrianglesAndChunksBesideFinePosts) {
  for (const double coarse_posts : {16.0, 256.0}) {
    SCOPED_TRACE(coarse_posts);
    std::mt19937 random(5);
    std::uniform_real_distribution<double> relief(-300, 300);
    const auto rough = [&](double lat, double lon) {
      // Waves that each spacing has posts enough for; at random they would be mountains at 256 posts a degree.
      return coarse_posts > 16 ? 300 * std::sin(60 * lat) * std::cos(47 * lon) : relief(random);
    };
    const Site alone(0, {}, waves_m), both(coarse_posts, rough, waves_m);
    std::size_t most_alone = 0, most = 0;
    for (int k = 0; k < 4; ++k) {
      most_alone = std::max(most_alone, alone.lit(90 * k).report.triangles);
      most = std::max(most, both.lit(90 * k).report.triangles);
    }
    EXPECT_LT(most, 6 * most_alone);  // divided as finely as the fine posts: a hundred times as many
    EXPECT_LT(both.terrain->statistics().chunks_built, 300U);
  }
}

// From the fine posts outward, over all borders of chunks, whose posts are twice as far apart each time: along the way
// no step from one fine post's place to the next is steeper than the relief. Chords of level 6 are metres off its
// curve.
TEST(CoarseLayer, HasNoWallsWhereItsChunksMeet) {
  const auto relief = [](double lat, double lon) { return 300 * std::sin(20 * lat) * std::cos(17 * lon); };
  const Site site(16, relief, relief);
  constexpr double kSteepest_m = 300 * 20 / kFine;
  for (const auto& [north, east] : {std::pair{0.0, 1.0}, {0.0, -1.0}, {1.0, 0.13}, {-1.0, -0.21}}) {
    double before = std::nan(""), steepest_m = 0;
    for (int k = 0; k < 6000; ++k) {
      const double away = k / kFine;
      const double height_m = site.terrain->height(kLat + away * north, kLon + away * east).height_m;
      ASSERT_FALSE(std::isnan(height_m));
      if (k > 0) steepest_m = std::max(steepest_m, std::abs(height_m - before));
      before = height_m;
    }
    EXPECT_LT(steepest_m, 1.5 * kSteepest_m) << north << " " << east;
    EXPECT_GT(steepest_m, 0.3 * kSteepest_m);
  }
}

// A wall of the coarse layer along a meridian, its crest some 1000 m above level ground: within the degree of the fine
// posts, and outside of it. Where its shadow ends on them follows from the crest's elevation over the horizon.
TEST(CoarseLayer, CastsAFarMountainsShadowOntoFinePosts) {
  struct Wall {
    double lon_deg, azimuth_deg;
  };
  for (const Wall& wall : {Wall{20.75, 90}, {21.5, 90}, {19.25, 270}}) {
    SCOPED_TRACE(wall.lon_deg);
    // So high that the shadow ends in the middle of the site. The great circle is that of the Sun's azimuth at the
    // site; over so short a way the crest's meridian is met as if it were straight.
    const double away =
        std::atan(std::tan(std::abs(wall.lon_deg - kLon) * kRadiansPerDegree) * std::cos(kLat * kRadiansPerDegree));
    // tan(elevation) = ((R + h) cos(away) - R) / ((R + h) sin(away))
    const double tangent = std::tan(kElevation_deg * kRadiansPerDegree);
    const double height_m = kMoonRadius_m / (std::cos(away) - tangent * std::sin(away)) - kMoonRadius_m;
    const auto ridge = [&](double, double lon) { return std::abs(lon - wall.lon_deg) < 0.03 ? height_m : 0; };
    const Site site(16, ridge, [](double, double) { return 0.0; });
    const Map map = site.lit(wall.azimuth_deg);
    int dark = 0, wrong = 0;
    for (int y = 0; y < 80; ++y)
      for (int x = 0; x < 80; ++x) {
        const bool lit = map.products.lit[static_cast<std::size_t>(80 * y + x)] > 0.5F;
        const bool near_wall = (x < 40) == (wall.azimuth_deg == 270);
        dark += !lit, wrong += lit == near_wall;
      }
    EXPECT_GT(dark, 80 * 30);
    EXPECT_LT(dark, 80 * 50);
    EXPECT_LE(wrong, 80 * map.report.shadow_error_px + 80) << map.report.shadow_error_px;
  }
}

// Beside a pole chords leave their parallels by metres, and what is finer than posts is no longer the same triangles.
TEST(CoarseLayer, ErrorsBesideAPoleAreWithinTheirBounds) {
  const test::TemporaryFolder folder;
  test::write_float_tile(folder.path(), "pole", {90, -180, 16, 65, 5761}, [](double lat, double lon) {
    const double x = (90 - lat) * std::cos(lon * test::kDegree), y = (90 - lat) * std::sin(lon * test::kDegree);
    return 900 * std::sin(7 * x) * std::sin(9 * y) + 400 * std::sin(23 * x + 11 * y);
  });
  const auto terrain = test::open_terrain(folder.path());
  const Renderer renderer(terrain, RendererOptions{2, std::size_t{1} << 30});
  double worst_share = 0;
  for (const Geographic& eye :
       {Geographic{89.5, 166, 3000}, {89.3, 20, 5000}, {89.75, 100, 12000}, {88.6, -30, 3000}}) {
    FrameRequest request;
    request.camera = test::square_camera(48, 50);
    const Vec3 place = to_cartesian(eye);
    request.pose = test::looking(place, -place, local_axes(place.normalized()).north);
    request.sun.direction = place.normalized();
    request.products = kGeodetic;
    for (const double max_error_px : {0.1, 0.5, 2.0}) {
      request.accuracy.max_error_px = max_error_px;
      const Frame frame = renderer.render(request);
      const std::vector<double>& found = frame.products.geodetic;
      double worst_m = 0;
      for (std::size_t i = 0; i + 2 < found.size(); i += 3)
        worst_m = std::max(worst_m, std::abs(found[i + 2] - terrain->height(found[i], found[i + 1]).height_m));
      EXPECT_LT(worst_m, frame.report.lod_error_m + 1e-4) << eye.lat_deg << " " << max_error_px;
      EXPECT_LE(frame.report.lod_error_px, max_error_px);
      worst_share = std::max(worst_share, worst_m / frame.report.lod_error_m);
    }
  }
  EXPECT_GT(worst_share, 0.1);  // bounds are of use
}

}  // namespace
}  // namespace selenograph::engine
