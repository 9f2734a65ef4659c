// A view over a cold cache has built what it can use, and no more.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

double bumpy(double lat, double lon) { return std::round(200 * std::sin(lat * 300) * std::sin(lon * 200)); }

// Two tiles of a degree and 2048 posts side by side, a chunk each: of a camera low over the western one the other is
// neither in view nor between it and the Sun, however high it may be.
TEST(ColdView, BuildsWhatItCanUse) {
  const TemporaryFolder folder;
  for (const int west : {2, 3}) write_kaguya_tile(folder.path(), 20, west, 1, 2048, bumpy);
  engine::FrameRequest q = blank_request();
  q.camera = square_camera(64, 20);
  const Vec3 eye = to_cartesian({19.5, 2.3, 4000});
  q.pose = looking(eye, -eye, local_axes(eye).north);
  q.sun.direction = local_sun(19.5, 2.3, 270, 60);
  q.products = engine::kRadiance | engine::kLit | engine::kRange;

  const auto cold = open_terrain(folder.path());
  const engine::Frame first = engine::Renderer(cold, {}).render(q);
  EXPECT_EQ(cold->statistics().chunks_built, 1U);

  const auto warm = open_terrain(folder.path());
  warm->ingest([](auto&&...) { return true; });
  const engine::Frame again = engine::Renderer(warm, {}).render(q);
  EXPECT_EQ(first.products.radiance, again.products.radiance);
  EXPECT_EQ(first.products.range, again.products.range);
}

// Three tiles in a row under a low Sun in the east, the camera over the western one: the middle one is low, and whether
// its hills shade anything in view only its posts tell. They do when they are high.
TEST(ColdView, LooksAtFilesBeforeItBuilds) {
  for (const double high : {0.0, 5000.0}) {
    const TemporaryFolder folder;
    const auto hills = [&](double lat, double lon) { return bumpy(lat, lon) + (lon > 3.1 && lon < 3.2 ? high : 0); };
    for (const int west : {2, 3}) write_kaguya_tile(folder.path(), 20, west, 1, 2048, hills);
    engine::FrameRequest q = blank_request();
    q.camera = square_camera(64, 20);
    const Vec3 eye = to_cartesian({19.5, 2.8, 4000});
    q.pose = looking(eye, -eye, local_axes(eye).north);
    q.sun.direction = local_sun(19.5, 2.8, 90, 20);
    q.products = engine::kRadiance | engine::kLit;

    const auto cold = open_terrain(folder.path());
    const engine::Frame first = engine::Renderer(cold, {}).render(q);
    EXPECT_EQ(cold->statistics().chunks_built, high > 0 ? 2U : 1U);

    const auto warm = open_terrain(folder.path());
    warm->ingest([](auto&&...) { return true; });
    const engine::Frame again = engine::Renderer(warm, {}).render(q);
    EXPECT_EQ(first.products.radiance, again.products.radiance);
    EXPECT_EQ(first.products.lit, again.products.lit);
    EXPECT_EQ(first.report.triangles, again.report.triangles);
    const bool dark = std::all_of(first.products.lit.begin(), first.products.lit.end(), [](auto l) { return l == 0; });
    EXPECT_EQ(dark, high > 0);
  }
}

}  // namespace
}  // namespace selenograph::test
