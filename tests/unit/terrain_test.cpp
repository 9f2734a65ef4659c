// Heights at places: on the posts, on the triangles between them, at every border there is.
#include "dem/terrain/terrain.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <Eigen/LU>
#include <atomic>
#include <chrono>
#include <cmath>
#include <future>
#include <random>
#include <thread>

#include "dem/base/parallel.h"
#include "dem/grid/surface.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

using test::open_terrain;
using test::TemporaryFolder;
using test::write_kaguya_tile;

double bumpy(double lat, double lon) {
  return std::round(800 * std::sin(lat * 40) * std::cos(lon * 37) + 300 * std::sin(lon * 211));
}

// The height of the plane through three places in the direction of a fourth, by Cramer's rule: p = d * s with n . (p -
// a) = 0.
double plane_height(const Geographic& a, const Geographic& b, const Geographic& c, double lat, double lon) {
  Eigen::Matrix<long double, 3, 3> m;  // nearly parallel columns
  const auto precise = [](const Vec3& v) { return Eigen::Vector3<long double>(v.x(), v.y(), v.z()); };
  m << precise(to_cartesian(a)), precise(to_cartesian(b)), precise(to_cartesian(c));
  // Weights w with m w = s * direction and sum(w) = 1.
  const auto sum = (m.inverse() * precise(to_cartesian({lat, lon, 0}).normalized())).sum();
  return static_cast<double>(1 / sum - static_cast<long double>(kMoonRadius_m));
}

TEST(Terrain, BetweenPostsPlaneTriangles) {
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 12, 20, 2, 256, bumpy);
  const auto terrain = open_terrain(folder.path());
  std::mt19937 random(2);
  std::uniform_real_distribution<double> any(0.02, 0.98);
  for (int i = 0; i < 3000; ++i) {
    const double south = 12 - static_cast<double>(1 + random() % 511) / 256,
                 west = 20 + static_cast<double>(random() % 511) / 256, step = 1.0 / 256;
    const double fy = any(random), fx = any(random);
    if (std::abs(fx + fy - 1) < 0.02) continue;  // the diagonal is a great circle: beside it lies the other triangle
    const auto post = [&](int j, int k) {
      return Geographic{south + j * step, west + k * step, bumpy(south + j * step, west + k * step)};
    };
    const double lat = south + fy * step, lon = west + fx * step;
    const double expected = fx + fy < 1 ? plane_height(post(0, 0), post(0, 1), post(1, 0), lat, lon)
                                        : plane_height(post(1, 1), post(1, 0), post(0, 1), lat, lon);
    ASSERT_NEAR(terrain->height(lat, lon).height_m, expected, 1e-5) << lat << ' ' << lon;
  }
}

TEST(Terrain, ContinuousAcrossEdgesOfQuadsBlocksAndChunks) {
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 21, 19, 2, 256, bumpy);
  const auto terrain = open_terrain(folder.path());
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(0.1, 1.9);
  constexpr double kTiny = 1e-9;  // 0.03 mm
  for (int i = 0; i < 2000; ++i) {
    const double edge = static_cast<double>(8 + random() % 496) / 256, free = any(random);
    // Slopes reach 10: no step of more than a millimetre.
    ASSERT_NEAR(terrain->height(19 + edge - kTiny, 19 + free).height_m,
                terrain->height(19 + edge + kTiny, 19 + free).height_m, 1e-3);
    ASSERT_NEAR(terrain->height(19 + free, 19 + edge - kTiny).height_m,
                terrain->height(19 + free, 19 + edge + kTiny).height_m, 1e-3);
    ASSERT_FALSE(std::isnan(terrain->height(19 + edge, 19 + free).height_m));
    ASSERT_FALSE(std::isnan(terrain->height(19 + free, 19 + edge).height_m));
  }
}

// Two loops have all places of an arena and wait for a block. A third caller, outside of any loop, must not have begun
// to load that block when it needs a place there itself.
TEST(Terrain, LoadersNeverWaitForTheirWaiters) {
  if (tbb::this_task_arena::max_concurrency() < 2) GTEST_SKIP() << "one core";
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 12, 20, 2, 256, bumpy);
  const auto terrain = open_terrain(folder.path());
  const BlockId id = block_at(8, static_cast<Tick>((90 + 11) * kTicksPerDegree), 201 * kTicksPerDegree);
  ASSERT_FALSE(terrain->node(id).empty);  // the pyramid is there
  using Clock = StopToken::Clock;
  const StopToken stop(Clock::now() + std::chrono::seconds(20));
  tbb::task_arena arena(2);
  std::atomic<int> in_loops{0};
  const auto waits_in_a_loop = [&] {
    in_arena(arena, [&] {
      in_parallel(1, [&](std::size_t) {
        ++in_loops;
        // Until the third has begun, or has come as far as it comes.
        const auto patience = Clock::now() + std::chrono::milliseconds(300);
        while (in_loops < 2 || (terrain->statistics().misses == 0 && Clock::now() < patience))
          std::this_thread::yield();
        terrain->block(id, stop);
      });
    });
  };
  auto first = std::async(std::launch::async, waits_in_a_loop),
       second = std::async(std::launch::async, waits_in_a_loop);
  while (in_loops < 2) std::this_thread::yield();
  std::shared_ptr<const Block> block;
  EXPECT_NO_THROW(block = in_arena(arena, [&] { return terrain->block(id, stop); }));
  EXPECT_NO_THROW(first.get());
  EXPECT_NO_THROW(second.get());
  EXPECT_TRUE(block);
}

// Tiles whose outermost posts lie half a post within their borders: whole blocks are between those of two tiles, and
// beside the poles.
TEST(Terrain, BlocksBetweenFarPostsHaveData) {
  for (const double ppd : {1.0, 2.0})
    for (const bool beside_fine : {false, true}) {
      SCOPED_TRACE(ppd);
      TemporaryFolder folder;
      const int n = static_cast<int>(ppd);
      const auto level = [](double, double) { return 100; };
      for (const int west : {0, 90, 180, 270})
        test::write_float_tile(folder.path(), "t" + std::to_string(west),
                               {90 - 0.5 / ppd, west + 0.5 / ppd, ppd, 180 * n, 90 * n}, level);
      if (beside_fine) test::write_float_tile(folder.path(), "fine", {10.2, 0.6, 512, 52, 52}, level);
      const auto terrain = open_terrain(folder.path());
      for (const auto& [lat, lon] :
           {std::pair(89.97, 20.0), std::pair(-89.9, -130.0), std::pair(10.05, 0.03), std::pair(10.15, 0.23),
            std::pair(10.0, 359.9), std::pair(-44.0, 90.1), std::pair(45.0, 179.8), std::pair(89.8, 270.2)}) {
        SCOPED_TRACE(std::to_string(lat) + ' ' + std::to_string(lon));
        EXPECT_NEAR(terrain->height(lat, lon).height_m, 100, 0.01);
        const auto ticks = [](double deg) { return static_cast<std::int64_t>(deg * kTicksPerDegree); };
        const auto at = [&](int l) {
          return block_at(l, static_cast<Tick>(ticks(lat + 90)), wrap_lon(ticks(lon + 180)));
        };
        for (int l = 0; l <= terrain->finest_level(at(kMaxLevel)); ++l) EXPECT_TRUE(terrain->has_data(at(l))) << l;
      }
    }
}

TEST(Terrain, SubdividedLevelsAreTheSameSurface) {
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 12, 20, 2, 16, bumpy);  // level 4; the finest asked for is 8
  const auto terrain = open_terrain(folder.path());
  const BlockId coarse_id =
      block_at(4, static_cast<Tick>(101 * kTicksPerDegree), static_cast<Tick>(201 * kTicksPerDegree));
  EXPECT_EQ(terrain->posts_level(coarse_id), 4);
  ASSERT_EQ(terrain->finest_level(coarse_id), 8);
  const auto coarse = terrain->block(coarse_id);
  std::size_t compared = 0;
  for (int level = 5; level <= 9; ++level)
    for (double lat = 10.1; lat < 12; lat += 0.37) {
      const auto fine = terrain->block(
          block_at(level, static_cast<Tick>((lat + 90) * kTicksPerDegree), static_cast<Tick>(201.1 * kTicksPerDegree)));
      if (!fine) continue;
      EXPECT_EQ(terrain->node(fine->id).error_m, 0);
      for (int r = 0; r <= 64; ++r)
        for (int c = 0; c <= 64; ++c) {
          const float h = fine->vertices[fine->index(r, c)].height_m;
          const double y = static_cast<double>(fine->extent.lat0 + r * fine->extent.lat_step - coarse->extent.lat0) /
                           coarse->extent.lat_step;
          const double x = static_cast<double>(fine->extent.lon0 + c * fine->extent.lon_step - coarse->extent.lon0) /
                           coarse->extent.lon_step;
          const int cr = std::min(static_cast<int>(y), 63), cc = std::min(static_cast<int>(x), 63);
          const double fy = y - cr, fx = x - cc;
          const auto at = [&](int j, int i) {
            return static_cast<double>(coarse->vertices[coarse->index(cr + j, cc + i)].height_m);
          };
          const double expected = fx + fy <= 1
                                      ? at(0, 0) + fx * (at(0, 1) - at(0, 0)) + fy * (at(1, 0) - at(0, 0))
                                      : at(1, 1) + (1 - fx) * (at(1, 0) - at(1, 1)) + (1 - fy) * (at(0, 1) - at(1, 1));
          if (std::isnan(expected)) continue;
          ASSERT_NEAR(static_cast<double>(h), expected, 1e-3);
          ASSERT_NEAR(fine->vertices[fine->index(r, c)].normal.norm(), 1, 1e-5);
          ++compared;
        }
    }
  EXPECT_GT(compared, 5000U);
}

TEST(Terrain, DescribesItself) {
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 13, 21, 2, 256, bumpy);
  const auto terrain = open_terrain(folder.path());
  ASSERT_EQ(terrain->roots().size(), 1U);
  EXPECT_TRUE(terrain->has_data(terrain->roots()[0]));
  EXPECT_TRUE(terrain->node_is_cheap(terrain->roots()[0]));
  EXPECT_TRUE(terrain->warnings().empty());
  terrain->height(12, 22);
  const CacheStatistics statistics = terrain->statistics();
  EXPECT_GT(statistics.bytes, 0U);
  EXPECT_GT(statistics.misses, 0U);
  EXPECT_EQ(statistics.chunks_rejected, 0U);
}

}  // namespace
}  // namespace selenograph::dem
