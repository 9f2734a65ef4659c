// Terrain that has to be built first: who waits leaves by its own token, and what was begun is not lost.
#include "dem/terrain/build_queue.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <optional>
#include <thread>
#include <vector>

#include "dem/base/error.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Clock = StopToken::Clock;
using test::open_terrain;
using test::TemporaryFolder;

// ---- the queue by itself: chunks are made of nothing, turns of what a test says
// ---------------------------------------

ChunkPlan plan(int column, bool direct = true) {
  ChunkPlan p;
  p.node = {kRootLevel, 20, column};
  p.direct = direct;
  p.exists = true;
  return p;
}

using Turn = BuildQueue::Turn;
Turn made() { return {std::make_shared<const Chunk>(), {}}; }

// Opens once; a test that fails doesn't wait for ever.
class Door {
 public:
  void open() { open_ = true; }
  void pass() const {
    for (const auto limit = Clock::now() + 20s; !open_ && Clock::now() < limit;) std::this_thread::sleep_for(1ms);
  }

 private:
  std::atomic<bool> open_{false};
};

StopToken in(Clock::duration time) { return StopToken(Clock::now() + time); }

TEST(BuildQueue, OneBuildServesAllWaiters) {
  std::atomic<int> turns{0};
  Door door;
  BuildQueue queue(1, [&](BuildQueue::Work&, const StopToken&) {
    ++turns;
    door.pass();
    return made();
  });
  std::vector<std::thread> clients;
  std::vector<std::shared_ptr<const Chunk>> got(6);
  for (auto& chunk : got) clients.emplace_back([&] { chunk = queue.get(plan(1), {}); });
  std::this_thread::sleep_for(50ms);
  door.open();
  for (auto& c : clients) c.join();
  for (const auto& chunk : got) EXPECT_EQ(chunk, got[0]);
  EXPECT_TRUE(got[0]);
  EXPECT_EQ(turns, 1);
}

TEST(BuildQueue, DepartedWaiterDoesNotCancelTheBuild) {
  std::atomic<int> turns{0};
  Door door;
  BuildQueue queue(1, [&](BuildQueue::Work&, const StopToken& stop) {
    ++turns;
    door.pass();
    stop.check();  // of the service alone
    return made();
  });
  const auto start = Clock::now();
  EXPECT_THROW(queue.get(plan(1), in(30ms)), Cancelled);
  const std::atomic<bool> left{true};
  EXPECT_THROW(queue.get(plan(1), StopToken(Clock::time_point::max(), &left)), Cancelled);
  EXPECT_LT(Clock::now() - start, 2s);
  std::thread other([&] { EXPECT_TRUE(queue.get(plan(1), {})); });
  std::this_thread::sleep_for(30ms);
  door.open();
  other.join();
  EXPECT_EQ(turns, 1);
}

TEST(BuildQueue, UnwantedBuildsAreDropped) {
  std::atomic<int> turns{0};
  Door door;
  BuildQueue queue(1, [&](BuildQueue::Work&, const StopToken&) {
    ++turns;
    door.pass();
    return made();
  });
  for (int i = 0; i < 12; ++i) EXPECT_THROW(queue.get(plan(i), in(1ms)), Cancelled);
  door.open();
  EXPECT_TRUE(queue.get(plan(99), {}));
  EXPECT_EQ(turns, 2) << "the first, which was begun, and the last";
}

TEST(BuildQueue, FinerChunksComeFirstAndOthersBetween) {
  std::vector<int> order;
  const auto coarse = plan(0, false);
  BuildQueue queue(1, [&](BuildQueue::Work& work, const StopToken&) -> Turn {
    if (work.plan.direct) {
      order.push_back(work.plan.node.col);
      return made();
    }
    if (work.finer_chunk) work.finer.blocks[work.finer_plan->node] = nullptr;
    const int done = static_cast<int>(work.finer.blocks.size());
    if (done < 3) {
      std::this_thread::sleep_for(50ms);
      return {nullptr, plan(done + 1)};
    }
    order.push_back(0);
    return made();
  });
  std::thread large([&] { EXPECT_TRUE(queue.get(coarse, {})); });
  std::this_thread::sleep_for(20ms);
  EXPECT_TRUE(queue.get(plan(7), {}));
  large.join();
  ASSERT_EQ(order.size(), 5U);
  EXPECT_EQ(order.back(), 0);
  EXPECT_NE(order[3], 7) << "a single chunk waited for all of the large one";
}

TEST(BuildQueue, ErrorsReachWaitersAndAreNotCached) {
  int turns = 0;
  BuildQueue queue(1, [&](BuildQueue::Work& work, const StopToken&) -> Turn {
    if (!work.plan.direct && !work.finer_chunk) return {nullptr, plan(1)};
    if (work.plan.direct && ++turns == 1) throw DataError("tile", "damaged");
    return made();
  });
  EXPECT_THROW(queue.get(plan(0, false), {}), DataError);
  EXPECT_TRUE(queue.get(plan(0, false), {}));
}

TEST(BuildQueue, ShutdownCancelsBuildsAndWaiters) {
  Door begun;
  std::optional<BuildQueue> queue;
  queue.emplace(1, [&](BuildQueue::Work&, const StopToken& stop) -> Turn {
    begun.open();
    for (;;) stop.check(), std::this_thread::sleep_for(1ms);
  });
  std::thread waiting([&] { EXPECT_THROW(queue->get(plan(1), {}), Cancelled); });
  begun.pass();
  const auto start = Clock::now();
  queue->stop();
  waiting.join();
  EXPECT_THROW(queue->get(plan(2), {}), Cancelled);
  queue.reset();
  EXPECT_LT(Clock::now() - start, 2s);
}

// ---- the terrain on it
// ------------------------------------------------------------------------------------------------

double hills(double lat, double lon) { return std::round(300 * std::sin(lat * 300) * std::sin(lon * 200)); }

// Two degrees of 2048 posts each: chunks of a square degree and one of what is coarser, some hundredths of a second
// each: more than who waits looks up after.
class ColdTerrain : public ::testing::Test {
 protected:
  ColdTerrain() { test::write_kaguya_tile(folder_ / "dem", 20, 1, 2, 2048, hills); }
  std::shared_ptr<PyramidTerrain> open() const { return open_terrain(folder_ / "dem", folder_ / "cache"); }
  static constexpr double kLat = 19.5, kLon = 1.5;
  // A coarse block: all of the tile is beneath it.
  static BlockId coarse() { return block_at(2, (90 + 19) * kTicksPerDegree, (180 + 1) * kTicksPerDegree); }
  TemporaryFolder folder_;
};

TEST_F(ColdTerrain, DeadlinesHoldAndTheBuildCompletes) {
  const auto terrain = open();
  const auto ask = [&](const StopToken& stop) {
    try {
      return !terrain->node(coarse(), stop).empty;
    } catch (const Cancelled&) {
      return false;
    }
  };
  int asked = 0;
  for (bool there = false; !there; ++asked) {
    ASSERT_LT(asked, 10000) << "each time it begins anew";
    const auto start = Clock::now();
    there = ask(StopToken(start + 10ms));
    EXPECT_LT(Clock::now() - start, 5s);
  }
  EXPECT_GT(asked, 1) << "too fast a machine, or too small a tile";
  terrain->wait_until_written();
  std::size_t files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder_ / "cache")) files += entry.is_regular_file();
  EXPECT_EQ(terrain->statistics().chunks_built, files) << "something was built twice";
  EXPECT_NEAR(terrain->height(kLat, kLon).height_m, hills(kLat, kLon), 1e-6);
}

TEST_F(ColdTerrain, EveryCallHonoursItsDeadline) {
  const auto terrain = open();
  const std::atomic<bool> left{true};
  const StopToken gone(Clock::time_point::max(), &left);
  const auto start = Clock::now();
  EXPECT_THROW(terrain->height(kLat, kLon, gone), Cancelled);
  EXPECT_THROW(terrain->node(coarse(), gone), Cancelled);
  EXPECT_THROW(terrain->block(coarse(), gone), Cancelled);
  EXPECT_LT(Clock::now() - start, 1s);
}

TEST_F(ColdTerrain, DepartedClientFailsNobody) {
  const auto terrain = open();
  std::vector<std::thread> impatient;
  std::atomic<int> given_up{0}, answered{0};
  for (int i = 0; i < 4; ++i)
    impatient.emplace_back([&] {
      try {
        terrain->block(coarse(), in(5ms));
      } catch (const Cancelled&) {
        ++given_up;
      }
    });
  std::vector<std::thread> patient;
  for (int i = 0; i < 3; ++i) patient.emplace_back([&] { answered += terrain->block(coarse()) != nullptr; });
  for (auto& t : impatient) t.join();
  for (auto& t : patient) t.join();
  EXPECT_EQ(given_up, 4);
  EXPECT_EQ(answered, 3);
}

TEST_F(ColdTerrain, ShutdownDuringABuild) {
  auto terrain = open();
  EXPECT_THROW(terrain->node(coarse(), in(3ms)), Cancelled);
  auto start = Clock::now();
  terrain->stop_building();
  EXPECT_THROW(terrain->node(coarse()), Cancelled);
  terrain.reset();
  EXPECT_LT(Clock::now() - start, 1s);
  terrain = open();
  std::thread waiting([&] { EXPECT_THROW(terrain->node(coarse()), Cancelled); });
  std::this_thread::sleep_for(5ms);
  start = Clock::now();
  terrain->stop_building();
  waiting.join();
  EXPECT_LT(Clock::now() - start, 1s);
  std::error_code missing;  // nothing was written
  for (const auto& entry : fs::recursive_directory_iterator(folder_ / "cache", missing))
    EXPECT_EQ(entry.path().string().find(".tmp-"), std::string::npos) << entry.path();
}

}  // namespace
}  // namespace selenograph::dem
