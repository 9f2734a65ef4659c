// A view over a cold cache has built what it can use, and no more.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>

#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

double rolling(double lat, double lon) { return std::round(200 * std::sin(lat * 300) * std::sin(lon * 200)); }

class ColdView : public ::testing::Test {
 protected:
  // Two tiles of a degree and 2048 posts side by side, a chunk each, 2 to 4 degrees east.
  template <typename Height>
  void tiles(const Height& height_m) {
    for (const int west : {2, 3}) write_kaguya_tile(folder_.path(), 20, west, 1, 2048, height_m);
  }

  // A frame of the ground below, over a cold cache that has `chunks` built for it. The same as over a warm one.
  engine::Frame frame(double lon_deg, double sun_azimuth_deg, double sun_elevation_deg, std::uint64_t chunks) const {
    engine::FrameRequest q = blank_request();
    q.camera = square_camera(64, 20);
    const Vec3 eye = to_cartesian({19.5, lon_deg, 4000});
    q.pose = looking(eye, -eye, local_axes(eye).north);
    q.sun.direction = local_sun(19.5, lon_deg, sun_azimuth_deg, sun_elevation_deg);
    q.products = engine::kRadiance | engine::kLit | engine::kRange;
    const auto cold = open_terrain(folder_.path()), warm = open_terrain(folder_.path());
    engine::Frame first = engine::Renderer(cold, {}).render(q);
    EXPECT_EQ(cold->statistics().chunks_built, chunks);
    warm->ingest([](auto&&...) { return true; });
    const engine::Frame again = engine::Renderer(warm, {}).render(q);
    EXPECT_EQ(first.products.radiance, again.products.radiance);
    EXPECT_EQ(first.products.lit, again.products.lit);
    EXPECT_EQ(first.products.range, again.products.range);
    EXPECT_EQ(first.report.triangles, again.report.triangles);
    return first;
  }

  const TemporaryFolder folder_;
};

// Of a camera low over the western one the other is neither in view nor between it and the Sun, however high it may be.
TEST_F(ColdView, BuildsVisibleTerrain) {
  tiles(rolling);
  frame(2.3, 270, 60, 1);
}

// Under a low Sun in the east: whether the other's hills shade anything in view only its posts tell.
TEST_F(ColdView, LooksAtLowTerrainAndDoesNotBuildIt) {
  tiles(rolling);
  const engine::Frame seen = frame(2.8, 90, 20, 1);
  EXPECT_TRUE(std::any_of(seen.products.lit.begin(), seen.products.lit.end(), [](auto lit) { return lit > 0; }));
}

TEST_F(ColdView, BuildsHighTerrainThatShades) {
  tiles([](double lat, double lon) { return rolling(lat, lon) + (lon > 3.1 && lon < 3.2 ? 5000 : 0); });
  const engine::Frame seen = frame(2.8, 90, 20, 2);
  EXPECT_TRUE(std::all_of(seen.products.lit.begin(), seen.products.lit.end(), [](auto lit) { return lit == 0; }));
}

}  // namespace
}  // namespace selenograph::test
