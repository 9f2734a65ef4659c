#include "api/message/memory_budget.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "api/service.h"
#include "dem/base/error.h"
#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::api {
namespace {

using namespace std::chrono_literals;
using Clock = StopToken::Clock;

TEST(MemoryBudget, ClaimsAreGivenBackOnce) {
  MemoryBudget budget(100);
  {
    auto first = budget.try_claim(60);
    ASSERT_TRUE(first);
    EXPECT_FALSE(budget.try_claim(41));
    auto second = budget.try_claim(40);
    ASSERT_TRUE(second);
    EXPECT_EQ(budget.in_use(), 100U);
    const MemoryBudget::Claim moved = std::move(*second);
    EXPECT_EQ(moved.bytes(), 40U);
    EXPECT_EQ(second->bytes(), 0U);
    first->resize(10);
    EXPECT_EQ(budget.in_use(), 50U);
    first->resize(200);  // it exists already: the budget only learns of it
    EXPECT_EQ(budget.in_use(), 240U);
    EXPECT_FALSE(budget.try_claim(0));
  }
  EXPECT_EQ(budget.in_use(), 0U);
}

TEST(MemoryBudget, AClaimGrowsIfThereIsRoom) {
  MemoryBudget budget(100);
  auto growing = budget.try_claim(0);
  ASSERT_TRUE(growing);
  EXPECT_TRUE(growing->try_resize(60));
  const auto other = budget.try_claim(30);
  EXPECT_FALSE(growing->try_resize(71));
  EXPECT_EQ(growing->bytes(), 60U);
  EXPECT_TRUE(growing->try_resize(70));
  EXPECT_TRUE(growing->try_resize(5));
  EXPECT_EQ(budget.in_use(), 35U);
  growing.reset();
  EXPECT_EQ(budget.in_use(), 30U);
  EXPECT_FALSE(MemoryBudget::Claim().try_resize(1));
}

TEST(MemoryBudget, AClaimWaitsForRoomUntilItsTime) {
  MemoryBudget budget(100);
  auto first = budget.try_claim(80);
  EXPECT_FALSE(budget.claim(30, Clock::now() + 20ms, {}));
  std::atomic<bool> got{false};
  std::thread waiting([&] {
    const auto claim = budget.claim(30, Clock::now() + 60s, {});
    got = claim.has_value();
  });
  first->resize(70);
  waiting.join();
  EXPECT_TRUE(got);
  EXPECT_EQ(budget.in_use(), 70U);
}

TEST(MemoryBudget, LargeClaimsAreNotStarved) {
  MemoryBudget budget(100);
  auto first = budget.try_claim(50);
  std::atomic<bool> large{false};
  std::thread waiting([&] { large = budget.claim(100, Clock::now() + 60s, {}).has_value(); });
  while (budget.try_claim(1)) std::this_thread::sleep_for(1ms);  // until it stands in the queue
  EXPECT_FALSE(budget.claim(1, Clock::now() + 60ms, {}));
  *first = MemoryBudget::Claim();
  first.reset();
  waiting.join();
  EXPECT_TRUE(large);
  EXPECT_TRUE(budget.try_claim(1)) << "nobody is left in the queue";
}

TEST(MemoryBudget, AWaitEndsWithItsStopToken) {
  MemoryBudget budget(100);
  const auto first = budget.try_claim(100);
  EXPECT_THROW(budget.claim(1, Clock::now() + 60s, StopToken(Clock::now() + 20ms)), Cancelled);
  const std::atomic<bool> left{true};
  EXPECT_THROW(budget.claim(1, Clock::now() + 60s, StopToken(Clock::time_point::max(), &left)), Cancelled);
  EXPECT_EQ(budget.in_use(), 100U);
}

TEST(MemoryBudget, ConcurrentClaimsNeverExceedTheCapacity) {
  MemoryBudget budget(1000);
  std::atomic<std::size_t> held{0}, most{0};
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < 8; ++t)
    threads.emplace_back([&, t] {
      for (std::size_t i = 0; i < 200; ++i) {
        const std::size_t bytes = 1 + (t * 131 + i * 57) % 600;
        const auto claim = budget.claim(bytes, Clock::now() + 60s, {});
        ASSERT_TRUE(claim);
        const std::size_t now = held += bytes;
        for (std::size_t seen = most; seen < now && !most.compare_exchange_weak(seen, now);) {
        }
        held -= bytes;
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_LE(most, 1000U);
  EXPECT_EQ(budget.in_use(), 0U);
}

TEST(MemoryBudget, UnboundedTakesEverything) {
  MemoryBudget budget;
  const auto all = budget.try_claim(MemoryBudget::kUnbounded / 2);
  EXPECT_TRUE(all);
  EXPECT_TRUE(budget.try_claim(1));
}

TEST(MemoryBudget, AnAnswerKeepsIt) {
  const test::TemporaryFolder folder;
  test::write_global_tile(folder / "dem", 1, [](double, double) { return 0.0; });
  auto memory = std::make_shared<MemoryBudget>(std::size_t{1} << 30);
  const std::weak_ptr<MemoryBudget> known = memory;
  Response answer;
  {
    const auto renderer = std::make_shared<engine::Renderer>(test::open_terrain(folder / "dem"),
                                                             engine::RendererOptions{1, std::size_t{256} << 20});
    Request request;
    request.method = "GET", request.path = "/v1/datasets";
    answer = Service(renderer, {}, {}, {}, std::move(memory)).handle(request);
  }
  EXPECT_EQ(answer.status, 200) << answer.body;
  ASSERT_FALSE(known.expired()) << "the service's end";
  EXPECT_GT(known.lock()->in_use(), 0U);
  answer = {};
  EXPECT_TRUE(known.expired());
}

}  // namespace
}  // namespace selenograph::api
