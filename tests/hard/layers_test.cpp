// A landing site's DTM with a known bias over a coarser layer: where it ends stands no cliff, and nothing that casts a
// shadow of its own at grazing Sun. Rays against the smooth truth.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "dem/posts/layer_joins.h"
#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/queries.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {
namespace {

using engine::Ray;
using engine::RayHit;
using engine::Sun;

constexpr double kBias_m = 60, kSunElevation_deg = 4;
constexpr double kMiddleLat = 20, kMiddleLon = 40;  // in the middle of the site

// Slopes below 1.5 degrees: nothing of it is shaded by a Sun 4 degrees high. Slow against both layers' posts.
double truth(double lat_deg, double lon_deg) {
  return 120 * std::sin(5 * (lat_deg - kMiddleLat) + 1) * std::cos(4 * (lon_deg - kMiddleLon)) +
         60 * std::cos(3 * lon_deg);
}

// 64 and 1024 posts a degree: a band of 16 posts of the coarser layer is 256 posts, of the site's 1025.
struct Site {
  Site(double blend_posts, std::optional<double> offset_m, bool fit = false) {
    write_float_tile(folder.path(), "coarse", {kMiddleLat + 1.5, kMiddleLon - 1.5, 64, 193, 193}, truth);
    write_float_tile(
        folder.path(), "site", {kMiddleLat + 0.5, kMiddleLon - 0.5, 1024, 1025, 1025},
        [](double lat, double lon) { return truth(lat, lon) + kBias_m; },
        [](double lat, double lon) {
          return lat + 0.3 * (lon - kMiddleLon) > kMiddleLat + 0.45;
        });  // a slanted end in the north
    dem::Catalogue catalogue(std::vector<std::string>{folder.path()});
    std::vector<dem::NamedNumber> offsets;
    if (fit || offset_m) offsets.push_back({"site", offset_m});
    dem::join_layers(catalogue, blend_posts, offsets);
    terrain = std::make_shared<dem::PyramidTerrain>(std::move(catalogue), dem::TerrainOptions{});
    renderer = std::make_unique<engine::Renderer>(terrain, engine::RendererOptions{});
  }
  TemporaryFolder folder;
  std::shared_ptr<dem::PyramidTerrain> terrain;
  std::unique_ptr<engine::Renderer> renderer;
};

struct SeenLayer {
  int shaded = 0, blended = 0;
  double highest_m = -1e9, lowest_m = 1e9;  // above the truth
  double steepest = 0;                      // of what is above the truth, between neighbouring rays
  double worst_height_m = 0;                // Terrain::height() against the ray that goes down there
};

// Rays straight down on lines across each of the four borders.
SeenLayer looked_at(const Site& site, double azimuth_deg) {
  constexpr int kRays = 600;
  constexpr double kStep_deg = 0.0011;
  const Vec3 middle = to_cartesian({kMiddleLat, kMiddleLon, 0});
  const Sun sun{engine::sun_direction(local_axes(middle), azimuth_deg, kSunElevation_deg), 1, 0, 0};
  SeenLayer seen;
  for (const auto& [dlat, dlon] : {std::pair{1.0, 0.0}, {-1.0, 0.0}, {0.0, 1.0}, {0.0, -1.0}})
    for (const double aside : {-0.3, -0.02, 0.21}) {
      std::vector<Ray> rays;
      std::vector<Geographic> places;
      for (int i = 0; i < kRays; ++i) {
        const double along = 0.1 + i * kStep_deg;
        places.push_back({kMiddleLat + dlat * along + dlon * aside, kMiddleLon + dlon * along + dlat * aside, 0});
        const Vec3 up = to_cartesian(places.back()).normalized();
        rays.push_back({up * (kMoonRadius_m + 5000), -up});
      }
      const std::vector<RayHit> hits = test::cast_rays(*site.renderer, rays, sun);
      double before = 0;
      for (int i = 0; i < kRays; ++i) {
        const auto at = static_cast<std::size_t>(i);
        EXPECT_TRUE(hits[at].hit);
        const Geographic met = to_geographic(hits[at].position_m);
        const double above = met.height_m - truth(places[at].lat_deg, places[at].lon_deg);
        seen.shaded += hits[at].lit < 1;
        seen.highest_m = std::max(seen.highest_m, above), seen.lowest_m = std::min(seen.lowest_m, above);
        if (i > 0) seen.steepest = std::max(seen.steepest, std::abs(above - before) / (kStep_deg * kMetresPerDegree));
        before = above;
        if (i % 7 == 0) {
          const dem::HeightAnswer answer = site.terrain->height(places[at].lat_deg, places[at].lon_deg);
          seen.worst_height_m = std::max(seen.worst_height_m, std::abs(answer.height_m - met.height_m));
          seen.blended += answer.blended;
        }
      }
    }
  return seen;
}

void report(const char* name, const SeenLayer& s) {
  fmt::print("{}: {} rays shaded, {:.2f} .. {:.2f} m above the truth, steepest {:.4f}\n", name, s.shaded, s.lowest_m,
             s.highest_m, s.steepest);
}

TEST(HardLayers, BiasedSiteHasNoCliffAtItsBorder) {
  const Site cliff(0, std::nullopt), blended(16, std::nullopt);
  int shaded_by_cliff = 0;
  for (const double azimuth_deg : {0.0, 90.0, 180.0, 270.0}) {
    SCOPED_TRACE(azimuth_deg);
    const SeenLayer before = looked_at(cliff, azimuth_deg), after = looked_at(blended, azimuth_deg);
    report("cliff", before), report("blended", after);
    shaded_by_cliff += before.shaded;
    EXPECT_GT(before.steepest, 1) << "otherwise nothing is shown";
    EXPECT_EQ(before.blended, 0);

    EXPECT_EQ(after.shaded, 0);
    EXPECT_GT(after.blended, 100);
    // The coarse layer's chords and its interpolation are off by decimetres.
    EXPECT_NEAR(after.highest_m, kBias_m, 0.5);
    EXPECT_NEAR(after.lowest_m, 0, 0.5);
    // 60 m over a band of 7.6 km: a smoothstep is 1.5 times as steep in its middle.
    EXPECT_LT(after.steepest, 2.5 * kBias_m / 7600);
    EXPECT_LT(after.worst_height_m, 0.05);
  }
  EXPECT_GT(shaded_by_cliff, 50) << "otherwise nothing is shown";
}

TEST(HardLayers, FittedOffsetRemovesTheBias) {
  const Site fitted(16, std::nullopt, true);
  const SeenLayer seen = looked_at(fitted, 90);
  report("fitted", seen);
  EXPECT_EQ(seen.shaded, 0);
  EXPECT_LT(std::max(std::abs(seen.highest_m), std::abs(seen.lowest_m)), 0.5);
  EXPECT_NEAR(fitted.terrain->catalogue().offset_m(1), -kBias_m, 0.2);
}

}  // namespace
}  // namespace selenograph::test
