// What admission by memory counts on: that a frame is rendered with no more than is estimated.
#include <gtest/gtest.h>

#include <cstddef>
#include <memory>
#include <utility>

#include "dem/terrain/pyramid_terrain.h"
#include "engine/cache/render_cache.h"
#include "engine/frame/needs.h"
#include "engine/frames/frame_selection.h"
#include "engine/frames/render_frame.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

class FrameMemory : public ::testing::Test {
 protected:
  static constexpr std::size_t kScenes = std::size_t{512} << 20;

  FrameMemory() {
    // Hills that shade each other, so that every list of the shadow map is used.
    write_global_tile(folder_.path(), 1,
                      [](double lat, double lon) { return 1500 * std::sin(lat * 3) * std::cos(lon * 3); });
    terrain_ = open_terrain(folder_.path());
  }

  static engine::FrameRequest request_at(double sun_elevation_deg, double disc_deg) {
    engine::FrameRequest q = blank_request();
    q.camera = square_camera(768, 60);
    const Vec3 eye = to_cartesian({10, 20, 200000});
    q.pose = looking(eye, -eye, local_axes(eye).north);
    q.sun.direction = local_sun(10, 20, 90, sun_elevation_deg);
    q.sun.angular_radius_deg = disc_deg;
    q.products = engine::kLit | engine::kRadiance;
    q.visibility = engine::Visibility::zbuffer;
    return q;
  }

  engine::SceneContent content_at(double lon_deg, engine::RenderCache& kept) const {
    engine::FrameRequest q = request_at(45, 0);
    const Vec3 eye = to_cartesian({10, lon_deg, 200000});
    q.pose = looking(eye, -eye, local_axes(eye).north);
    q.accuracy.max_error_px = 1;
    const engine::RowViews views(q.camera, q.pose, q.shutter);
    return content_of(q, views, select_blocks(q, views, q.accuracy, {*terrain_, kept, {}}), *terrain_);
  }

  TemporaryFolder folder_;
  std::shared_ptr<dem::PyramidTerrain> terrain_;
};

TEST_F(FrameMemory, ScratchStaysBelowTheEstimate) {
  for (const double disc_deg : {0.0, 0.27})
    for (const auto& [elevation_deg, samples] : {std::pair{3.0, 1}, {45.0, 1}, {45.0, 4}, {45.0, 9}}) {
      engine::RenderCache kept(terrain_, kScenes, 2);
      engine::FrameRequest q = request_at(elevation_deg, disc_deg);
      q.accuracy.samples_per_pixel = samples;
      render_frame(q, {*terrain_, kept, {}});
      const double per_pixel =
          static_cast<double>(kept.scratch().bytes()) / static_cast<double>(engine::rendered_pixels(q));
      RecordProperty("bytes_per_pixel", std::to_string(per_pixel));
      EXPECT_GT(per_pixel, 8);
      EXPECT_LT(per_pixel, static_cast<double>(engine::working_bytes_per_pixel(q)))
          << "disc " << disc_deg << " elevation " << elevation_deg << " samples " << samples;
    }
}

TEST_F(FrameMemory, NextFrameWaitsForAPinnedScene) {
  engine::RenderCache kept(terrain_, std::size_t{4} << 20, 1);
  auto first = kept.scene(content_at(20, kept));
  ASSERT_GT(first->bytes, std::size_t{2} << 20) << "two of them must be too many";
  const StopToken soon(StopToken::Clock::now() + std::chrono::milliseconds(50));
  EXPECT_THROW(kept.scene(content_at(60, kept), soon), Cancelled);
  first.reset();
  const auto second = kept.scene(content_at(60, kept));
  EXPECT_GT(second->bytes, 0U);
  EXPECT_LE(kept.bytes(), std::size_t{4} << 20);
}

TEST_F(FrameMemory, PreparationKeepsTheLatestScene) {
  engine::RenderCache kept(terrain_, std::size_t{4} << 20, 1);
  const engine::SceneContent here = content_at(20, kept), next = content_at(60, kept);
  kept.scene(here);
  EXPECT_THROW(kept.scene(next, {}, engine::RenderCache::Purpose::preparation), Cancelled);
  EXPECT_TRUE(kept.holds(here));
  kept.scene(next);  // a frame has its scene all the same
  EXPECT_TRUE(kept.holds(next));
  EXPECT_FALSE(kept.holds(here));
}

TEST_F(FrameMemory, PreparedScenesTakeHalfOfTheCache) {
  engine::RenderCache large(terrain_, kScenes, 1);
  const std::size_t scene_bytes = large.scene(content_at(20, large))->bytes;
  engine::RenderCache kept(terrain_, 5 * scene_bytes, 1);
  const auto prepare = [&](double lon_deg) {
    kept.scene(content_at(lon_deg, kept), {}, engine::RenderCache::Purpose::preparation);
  };
  kept.scene(content_at(20, kept));
  prepare(60);
  prepare(100);
  EXPECT_THROW(prepare(140), Cancelled);
  kept.scene(content_at(60, kept));
  prepare(140);
  EXPECT_EQ(kept.preparation_statistics().prepared, 3U);
  EXPECT_EQ(kept.preparation_statistics().used, 1U);
}

// Of another anchor a scene takes shapes over, and holds on to nothing else of the one before.
TEST_F(FrameMemory, VerticesOfOtherAnchorsAreFreed) {
  engine::RenderCache kept(terrain_, kScenes, 1);
  engine::SceneContent content = content_at(20, kept);
  const std::shared_ptr<const engine::Scene> scene = kept.scene(content);
  const engine::SceneParts same = scene->parts_for(content.anchor_m),
                           other = scene->parts_for(content.anchor_m + Vec3(4096, 0, 0));
  EXPECT_EQ(same.raster.pieces.size(), scene->raster->pieces().size());
  EXPECT_TRUE(other.raster.pieces.empty());
  EXPECT_EQ(other.raster.shapes.size(), scene->raster->pieces().size());
}

}  // namespace
}  // namespace selenograph::test
