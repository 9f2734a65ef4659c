// Which blocks a frame needs: errors bounded as promised, nothing overlapping, the same whatever was loaded before.
#include "engine/scene/selection.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <tuple>
#include <unordered_set>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/detail/detail.h"
#include "dem/detail/detailed_terrain.h"
#include "engine/scene/anchor.h"
#include "engine/scene/mesh.h"
#include "engine/scene/node_bounds.h"
#include "engine/scene/ray_selection.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;
using test::TemporaryFolder;

double rough_ground(double lat, double lon) {
  return 1500 * std::sin(lat * 6 + std::cos(lon * 3)) + 400 * std::cos(lon * 31 + lat * 13) +
         90 * std::sin(lon * 171) * std::cos(lat * 203) + 20 * std::sin(lat * 900 + lon * 1100);
}

View view_from(const Vec3& from, const Vec3& target, double focal_px) {
  const Vec3 z = (target - from).normalized(), x = z.cross(from.normalized() + Vec3(1e-3, 2e-3, 3e-3)).normalized();
  return View({512, 512, focal_px, focal_px, 255.5, 255.5, {}},
              {from, Quat(Mat3::from_rows(x, z.cross(x), z)).normalized()});
}

NodeBounds bounds_in(const dem::Terrain& terrain, const BlockId& id) {
  const dem::NodeInfo info = terrain.node(id);
  return bounds_of(id, static_cast<double>(info.min_m), static_cast<double>(info.max_m));
}
bool in_view(const dem::Terrain& terrain, const View& view, const BlockId& id) {
  const NodeBounds b = bounds_in(terrain, id);
  return view.may_see(b.centre, b.radius_m) && view.may_see(b.points, b.bulge_m);
}

class SelectionTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    test::write_float_tile(folder_->path(), "t", {14, 22, 128, 8 * 128 + 1, 8 * 128 + 1}, rough_ground);
    terrain_ = open();
  }
  static void TearDownTestSuite() {
    terrain_.reset();
    delete folder_;
  }
  static std::shared_ptr<dem::PyramidTerrain> open() { return test::open_terrain(folder_->path()); }
  static std::vector<View> views() {
    return {view_from(to_cartesian({10, 26, 100000}), to_cartesian({10, 26, 0}), 1000),     // nadir
            view_from(to_cartesian({9, 25, 20000}), to_cartesian({11, 27, 0}), 800),        // oblique
            view_from(to_cartesian({10, 26, 5000}), to_cartesian({10.5, 27.5, 500}), 600),  // towards the horizon
            view_from(to_cartesian({10, 26, 3e6}), to_cartesian({10, 26, 0}), 9000)};
  }
  static std::shared_ptr<dem::PyramidTerrain> nearly_level(const TemporaryFolder& folder) {
    test::write_float_tile(folder.path(), "t", {14, 22, 128, 8 * 128 + 1, 8 * 128 + 1},
                           [](double lat, double lon) { return 0.02 * rough_ground(lat, lon); });
    return test::open_terrain(folder.path());
  }
  static TemporaryFolder* folder_;
  static std::shared_ptr<dem::PyramidTerrain> terrain_;
};
TemporaryFolder* SelectionTest::folder_ = nullptr;
std::shared_ptr<dem::PyramidTerrain> SelectionTest::terrain_;

// The height of a mesh of blocks in a direction from the centre; NaN where it has none.
double height_of(const Mesh& mesh, double lat, double lon) {
  const auto y = std::llround((lat + 90) * dem::kTicksPerDegree), x = std::llround((lon + 180) * dem::kTicksPerDegree);
  const Vec3 direction = to_cartesian({lat, lon, 0}).normalized();
  for (const std::int64_t dy : {0, -1, 1})
    for (const std::int64_t dx : {0, -1, 1}) {
      const auto at = mesh.block_at(y, x);
      if (!at) return std::nan("");
      const dem::BlockExtent& e = mesh.blocks()[*at].posts->extent;
      const auto r = (y - e.lat0) / e.lat_step + dy, c = (x - e.lon0) / e.lon_step + dx;
      if (r < 0 || c < 0 || r >= e.quads || c >= e.quads) continue;
      for (const bool upper : {false, true})
        if (const auto d = dem::radial_distance(
                mesh.triangle({*at, static_cast<std::uint16_t>(r), static_cast<std::uint16_t>(c), upper}), direction,
                1e-9))
          return *d - kMoonRadius_m;
    }
  return std::nan("");
}

TEST_F(SelectionTest, TheReportedErrorHolds) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(0, 1);
  for (const View& view : views())
    for (const double allowed : {0.5, 2.0}) {
      const Selection s = select_for_view(*terrain_, view, nullptr, {.max_error_px = allowed}, {});
      const Mesh mesh(*terrain_, s.blocks);
      double worst = 0, worst_m = 0;
      int compared = 0;
      for (int i = 0; i < 6000; ++i) {
        const double lat = 6.1 + 7.8 * any(random), lon = 22.1 + 7.8 * any(random);
        const double truth = terrain_->height(lat, lon).height_m;
        const Vec3 p = to_cartesian({lat, lon, truth});
        const auto pixel = view.project(p);
        if (!pixel || pixel->x < -0.5 || pixel->y < -0.5 || pixel->x > 511.5 || pixel->y > 511.5) continue;
        if ((view.position() - p).dot(p) < 0) continue;  // on the far side of the horizon
        const double drawn = height_of(mesh, lat, lon);
        ASSERT_FALSE(std::isnan(drawn)) << "a hole at " << lat << ' ' << lon;
        const auto moved = view.project(to_cartesian({lat, lon, drawn}));
        ASSERT_TRUE(moved);
        worst = std::max(worst, std::hypot(moved->x - pixel->x, moved->y - pixel->y));
        worst_m = std::max(worst_m, std::abs(drawn - truth));
        ++compared;
      }
      EXPECT_GT(compared, 100);
      EXPECT_LE(s.error_px, allowed);
      EXPECT_LE(worst, s.error_px + 1e-6);
      // The reported sag of the chords (8 mm at the posts' level here) is that over level ground; on slopes of 45
      // degrees it is threefold.
      EXPECT_LE(worst_m, s.error_m + 2 * dem::chord_sag_m(7));
    }
}

// A block in view whose edge joins that of a coarser block beside the image: where the edge's quads are seen, the
// coarser block's error holds, too; elsewhere it may be as coarse as its shadow allows.
TEST_F(SelectionTest, EdgesBesideTheImageAreAsFineAsTheyAreSeen) {
  // Nearly level, with quads of some 40 pixels: they reach farther into the image than blocks' bounds beyond it.
  const TemporaryFolder folder;
  const auto terrain = nearly_level(folder);
  std::mt19937 random(11);
  std::uniform_real_distribution<double> any(-1, 1);
  constexpr double kAllowed_px = 0.02;
  int coarse = 0;
  for (int i = 0; i < 1000; ++i) {
    const double lat = 10 + 2 * any(random), lon = 26 + 2 * any(random);
    const View view = view_from(to_cartesian({lat, lon, 6000 + 4000 * any(random)}), to_cartesian({lat, lon, 0}), 900);
    const EastNorthUp axes = local_axes(to_cartesian({lat, lon, 0}));
    const Sun sun{(axes.up * 0.2 + axes.east).normalized()};
    const Selection s =
        select_for_view(*terrain, view, &sun, {.max_error_px = kAllowed_px, .max_shadow_error_px = 40}, {});
    const std::set<BlockId> chosen(s.blocks.begin(), s.blocks.end());
    for (const BlockId& id : s.blocks) {
      if (!in_view(*terrain, view, id)) continue;
      const dem::BlockExtent e = dem::extent_of(id);
      const auto block = terrain->block(id);
      for (int side = 0; side < 4; ++side) {
        const bool along_row = side < 2;
        const dem::Tick across[] = {-1, (along_row ? e.lat1() - e.lat0 : e.lon1() - e.lon0)};
        const dem::Tick lat_beside = along_row ? e.lat0 + across[side % 2] : (e.lat0 + e.lat1()) / 2,
                        lon_beside = along_row ? (e.lon0 + e.lon1()) / 2 : e.lon0 + across[side % 2];
        const BlockId beside = dem::block_at(id.level - 1, lat_beside, dem::wrap_lon(lon_beside));
        if (!chosen.contains(beside) || in_view(*terrain, view, beside)) continue;
        const NodeBounds b = bounds_in(*terrain, id);
        const double error_px = (terrain->node(beside).error_m + dem::chord_sag_m(beside.level)) *
                                view.pixels_per_metre(b.centre, b.radius_m, b.high_m + b.bulge_m);
        std::vector<Vec3> quads;  // their corners
        for (int k = 0; k <= e.quads; ++k)
          for (int deep = 0; deep < 2; ++deep) {
            const int line = side % 2 ? e.quads - deep : deep, r = along_row ? line : k, c = along_row ? k : line;
            quads.push_back(block->position(r, c, static_cast<double>(block->vertices[block->index(r, c)].height_m)));
          }
        coarse += error_px > kAllowed_px;
        if (view.may_see(quads, 0)) {
          EXPECT_LE(error_px, kAllowed_px) << i;
        }
      }
    }
  }
  EXPECT_GT(coarse, 1000);
}

TEST_F(SelectionTest, ZeroMeansTheFinestPosts) {
  const Selection s = select_for_view(*terrain_, views()[1], nullptr, {.max_error_px = 0}, {});
  ASSERT_FALSE(s.blocks.empty());
  for (const BlockId& id : s.blocks) EXPECT_EQ(id.level, 8);
  EXPECT_EQ(s.min_spacing_m, s.max_spacing_m);
}

TEST_F(SelectionTest, NeighboursDifferByOneLevelAndNothingOverlaps) {
  const Sun sun{Vec3(0.3, 0.9, 0.1).normalized(), 1, 0};
  for (const View& view : views()) {
    const Selection s = select_for_view(*terrain_, view, &sun, {.max_error_px = 0.5}, {});
    EXPECT_TRUE(std::is_sorted(s.blocks.begin(), s.blocks.end()));
    const std::unordered_set<BlockId, dem::BlockIdHash> chosen(s.blocks.begin(), s.blocks.end());
    ASSERT_EQ(chosen.size(), s.blocks.size());
    for (const BlockId& id : s.blocks) {
      for (BlockId up = id; up.level > 0;) {
        up = dem::ancestor_of(up, up.level - 1);
        ASSERT_FALSE(chosen.contains(up)) << to_string(up) << " holds " << to_string(id);
      }
      const dem::BlockExtent e = dem::extent_of(id);
      for (const std::int64_t y :
           {std::int64_t{e.lat0} - 1, std::int64_t{e.lat0}, std::int64_t{e.lat1()} - 1, std::int64_t{e.lat1()}})
        for (const std::int64_t x :
             {std::int64_t{e.lon0} - 1, std::int64_t{e.lon0}, std::int64_t{e.lon1()} - 1, std::int64_t{e.lon1()}})
          for (int level = id.level - 2; level >= 0; --level)
            ASSERT_FALSE(chosen.contains(dem::block_at(level, static_cast<dem::Tick>(y), dem::wrap_lon(x))))
                << to_string(id);
    }
  }
}

TEST_F(SelectionTest, DoesNotDependOnLoadedBlocks) {
  const Sun sun{Vec3(0.3, 0.9, 0.1).normalized(), 1, 0};
  std::vector<std::vector<BlockId>> expected;
  for (const View& view : views())
    expected.push_back(select_for_view(*open(), view, &sun, {.max_error_px = 0.5}, {}).blocks);
  const auto warm = open();
  const auto all = views();
  for (std::size_t i = all.size(); i-- > 0;)
    EXPECT_EQ(select_for_view(*warm, all[i], &sun, {.max_error_px = 0.5}, {}).blocks, expected[i]);
  for (std::size_t i = 0; i < all.size(); ++i)
    EXPECT_EQ(select_for_view(*warm, all[i], &sun, {.max_error_px = 0.5}, {}).blocks, expected[i]);
}

std::size_t scene_bytes(const Selection& selection) {
  std::size_t bytes = 0;
  for (const BlockId& id : selection.blocks) bytes += scene_bytes_of(id, Visibility::automatic);
  return bytes;
}

// Under a low Sun, where an edge moves by up to 5700 times the height error, the aim has far to go.
TEST_F(SelectionTest, ShadowErrorIsRelaxedUntilTheSceneFits) {
  const View view = views()[1];
  const Vec3 up = view.position().normalized();
  const Sun low{(local_axes(up).east + 0.01 * up).normalized(), 1, 0};
  const auto with_aim = [&](double aim_px, const SceneBudget& room) {
    return select_for_view(*terrain_, view, &low, {.max_error_px = 8, .max_shadow_error_px = aim_px}, {}, room);
  };
  const std::size_t least = scene_bytes(with_aim(1e6, {})), at_128_px = scene_bytes(with_aim(128, {}));
  ASSERT_GT(at_128_px, 2 * least) << "an aim of 128 px is too much as well";
  const SceneBudget room{.bytes = least + least / 4};
  const Selection selection = with_aim(Accuracy::kDefaultShadowError_px, room);
  EXPECT_LE(scene_bytes(selection), room.bytes);
  EXPECT_GT(selection.shadow_limit_px, 128);
  EXPECT_LE(selection.shadow_error_px, selection.shadow_limit_px);
  EXPECT_EQ(selection.blocks, with_aim(selection.shadow_limit_px, {}).blocks) << "as asked for by its number";
  EXPECT_GT(scene_bytes(with_aim(selection.shadow_limit_px / 2, {})), room.bytes) << "no farther than it has to";
  EXPECT_THROW(with_aim(Accuracy::kDefaultShadowError_px, {.bytes = least / 2}), TooMuchTerrain);
}

// At the terminator an error of 1 km moves a shadow's edge by 59 km, two pixels of this image, however low the Sun is.
TEST(Selection, TheWholeMoonAtTheTerminatorNeedsNoFinerGround) {
  const TemporaryFolder folder;
  test::write_global_tile(folder.path(), 4, [](double lat, double lon) {
    return 1500 * std::sin(lat / 2 + std::cos(lon / 4)) + 800 * std::sin(lon * 2.3) * std::cos(lat * 1.9);
  });
  const auto terrain = test::open_terrain(folder.path());
  const Vec3 from = to_cartesian({0, 0, 384.4e6});
  View view = view_from(from, Vec3::zero(), 13000);
  Camera camera = view.camera();
  camera.width = camera.height = 140, camera.cx = camera.cy = 69.5;
  view = View(camera, {from, Quat(view.moon_from_camera()).conjugate()});
  const Sun sun{to_cartesian({1.5, 75, 0}).normalized()};
  const Accuracy accuracy;
  const Selection without = select_for_view(*terrain, view, nullptr, accuracy, {}),
                  with = select_for_view(*terrain, view, &sun, accuracy, {});
  EXPECT_LE(with.shadow_error_px, accuracy.max_shadow_error_px);
  EXPECT_EQ(with.min_spacing_m, without.min_spacing_m);
  EXPECT_LT(triangles_of(with), triangles_of(without) + 6 * 140 * 140);
}

TEST_F(SelectionTest, RaysFindTheFinestBlocksTheyMeet) {
  const Vec3 from = to_cartesian({10, 26, 50000});
  std::vector<RayCone> rays{
      {from, -from.normalized()}, {from, (to_cartesian({11, 27, 0}) - from).normalized()}, {from, from.normalized()}};
  const auto met = *select_for_rays(*terrain_, rays, 1000, {});
  std::vector<BlockId> blocks;
  for (const BlockOnRays& block : met) {
    EXPECT_EQ(block.id.level, 8);
    // Straight down, or away to the side; none of them the ray that looks up.
    ASSERT_FALSE(block.rays.empty());
    EXPECT_LE(block.rays.back(), 1U);
    blocks.push_back(block.id);
  }
  for (const std::size_t ray : {0U, 1U})
    EXPECT_TRUE(std::any_of(met.begin(), met.end(), [&](const BlockOnRays& block) {
      return std::find(block.rays.begin(), block.rays.end(), ray) != block.rays.end();
    }));
  const Mesh mesh(*terrain_, blocks);
  EXPECT_TRUE(mesh.block_at(std::llround(100 * dem::kTicksPerDegree), std::llround(206 * dem::kTicksPerDegree)));
  EXPECT_TRUE(mesh.block_at(std::llround(101 * dem::kTicksPerDegree), std::llround(207 * dem::kTicksPerDegree)));
  EXPECT_LT(blocks.size(), 20U);
}

// What is met is met from above: where a ray leaves the Moon again doesn't matter.
TEST(RaySelection, EndsBelowAllTerrain) {
  const test::TemporaryFolder folder;
  for (const auto& [name, west_deg] : {std::pair("near", 2.0), {"far", 182.0}})
    test::write_float_tile(folder / "dem", name, {3, west_deg, 16, 97, 97}, [](double, double) { return 0.0; });
  const auto terrain = test::open_terrain(folder / "dem");
  const Vec3 from = to_cartesian({0, 5, 50000});
  for (const double slope : {0.0, 0.01}) {
    RayCone ray{from, -from.normalized(), 100 * slope, slope};
    const auto through = *select_for_rays(*terrain, {ray}, 1000, {});
    ray.to_m = range_below_terrain_m(ray);
    const auto met = *select_for_rays(*terrain, {ray}, 1000, {});
    const auto of_near_side = [](const BlockOnRays& block) {
      return bounds_of(block.id, block.low_m, block.high_m).centre.x() > 0;
    };
    EXPECT_FALSE(std::all_of(through.begin(), through.end(), of_near_side));
    EXPECT_TRUE(std::all_of(met.begin(), met.end(), of_near_side));
    EXPECT_EQ(met.size(), std::count_if(through.begin(), through.end(), of_near_side));
    EXPECT_NEAR(ray.to_m, 50000 - dem::kLowestRelief_m, slope == 0 ? 1e-6 : 0.02 * kMoonRadius_m);
  }
  for (const Vec3& direction : {from.normalized(), local_axes(from).east})
    EXPECT_FALSE(std::isfinite(range_below_terrain_m({from, direction})));
}

TEST_F(SelectionTest, GroundIsSelectedTheSameByAnyThreads) {
  const Sun sun{to_cartesian({9, 95, 0}).normalized()};
  for (const View& view : views()) {
    tbb::task_arena one(1), two(2);
    const auto select = [&] {
      return select_for_view(*terrain_, view, &sun, {.max_error_px = 0.25, .max_shadow_error_px = 4}, {});
    };
    const Selection a = in_arena(one, select), b = in_arena(two, select);
    EXPECT_GT(a.blocks.size(), 10U);
    EXPECT_EQ(a.blocks, b.blocks);
    for (double Selection::*bound : {&Selection::error_px, &Selection::error_m, &Selection::shadow_error_px,
                                     &Selection::min_spacing_m, &Selection::max_spacing_m, &Selection::highest_m})
      EXPECT_EQ(a.*bound, b.*bound);
  }
}

// Blocks with detail are made while they are selected, by all threads.
TEST_F(SelectionTest, DetailIsSelectedTheSameByAnyThreads) {
  dem::DetailPreset preset;
  preset.craters.smallest_m = 4, preset.craters.largest_m = 200;
  const auto detail = std::make_shared<const dem::Detail>(preset);
  const Sun sun{to_cartesian({9, 95, 0}).normalized()};
  const std::vector<View> from{view_from(to_cartesian({10, 26, 6000}), to_cartesian({10, 26, 0}), 1000),
                               view_from(to_cartesian({10, 26, 2000}), to_cartesian({10.05, 26.05, 0}), 600)};
  for (const View& view : from)
    for (const Accuracy& accuracy : {Accuracy{}, Accuracy{.max_error_px = 4, .max_detail_error_px = 8}}) {
      std::optional<Selection> by_one;
      for (const int threads : {1, 2}) {
        const dem::DetailedTerrain terrain(open(), detail);
        tbb::task_arena arena(threads);
        const Selection s = in_arena(arena, [&] { return select_for_view(terrain, view, &sun, accuracy, {}); });
        if (!by_one) {
          EXPECT_GT(std::count_if(s.blocks.begin(), s.blocks.end(),
                                  [&](const BlockId& id) { return terrain.has_detail(id); }),
                    50);
          by_one = s;
        }
        EXPECT_EQ(s.blocks, by_one->blocks) << threads;
        EXPECT_EQ(s.detail_limit_px, by_one->detail_limit_px) << threads;
        EXPECT_EQ(s.error_px, by_one->error_px) << threads;
        EXPECT_EQ(s.shadow_error_px, by_one->shadow_error_px) << threads;
      }
    }
}

// Once shadows' target was let go for good before detail gave way: edges could be off by tens of thousands of pixels.
TEST_F(SelectionTest, WhereDetailGivesWayShadowsKeepTheirTarget) {
  dem::DetailPreset preset;
  preset.craters.smallest_m = 0.25;
  const dem::DetailedTerrain terrain(open(), std::make_shared<const dem::Detail>(preset));
  const Sun sun{sun_direction(local_axes(10, 26), 90, 20)};
  const double ground_m = terrain.height(10, 26, {}).height_m;
  const Accuracy accuracy{.max_detail_error_px = 1.5};
  int gave_way = 0;
  for (const double height_m : {110, 90, 75, 62}) {
    const View view = view_from(to_cartesian({10, 26, ground_m + height_m}), to_cartesian({10, 26, 0}), 400);
    const Selection s = select_for_view(terrain, view, &sun, accuracy, {});
    gave_way += s.detail_limit_px > accuracy.detail_aim_px();
    EXPECT_LE(s.shadow_limit_px, 512) << height_m;
  }
  EXPECT_GT(gave_way, 0);
}

TEST_F(SelectionTest, StopsWhenTold) {
  EXPECT_THROW(select_for_view(*terrain_, views()[0], nullptr, {.max_error_px = 0}, StopToken(StopToken::Clock::now())),
               Cancelled);
}

// The farther away everything is, the longer frames share an anchor; as the camera sees it, float is as fine.
TEST(Anchor, IsNearAsMeasuredByWhatIsSeen) {
  const Vec3 down = -Vec3::unit_x();
  for (const double clearance_m : {0.0, 100.0, 1000.0, 2048.0, 5000.0, 8192.0, 1e5}) {
    double farthest_m = 0;
    int changes = 0;
    const int steps = 3000;
    Vec3 before = Vec3::zero();
    for (int i = 0; i < steps; ++i) {
      const Vec3 camera = to_cartesian({0.01 * i, 0.003 * i, clearance_m});
      const Vec3 anchor = anchor_for(camera, down, clearance_m);
      farthest_m = std::max(farthest_m, (anchor - camera.normalized() * kMoonRadius_m).norm());
      changes += i > 0 && anchor != before;
      before = anchor;
    }
    const double lattice_m = std::clamp(std::exp2(std::floor(std::log2(4 * clearance_m))), 4096.0, 32768.0);
    EXPECT_LE(farthest_m, std::sqrt(3.0) / 2 * lattice_m + 1e-6) << clearance_m;
    EXPECT_LE(changes, 2.1 * steps * 316 / lattice_m) << clearance_m;  // 316 m a step, along three axes
  }
}

// Over fine ground it is among the posts, at their height; seen from afar it is as over any.
TEST(Anchor, IsAmongFinePosts) {
  const Vec3 down = -Vec3::unit_x();
  const FineGround fine{0.06, -1900};
  for (int i = 0; i < 300; ++i) {
    const Vec3 foot = to_cartesian({26 + 0.001 * i, 3.6, fine.height_m});
    EXPECT_LE((anchor_for(foot + 8 * foot.normalized(), down, -500, fine) - foot).norm(), std::sqrt(3.0) / 2 * 128);
    const Vec3 high = foot + 20000 * foot.normalized();
    EXPECT_EQ(anchor_for(high, down, 9000, fine), anchor_for(high, down, 9000));
  }
}

}  // namespace
}  // namespace selenograph::engine
