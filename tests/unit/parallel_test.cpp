#include "dem/base/parallel.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <atomic>
#include <chrono>
#include <future>
#include <stdexcept>
#include <thread>

namespace selenograph {
namespace {

constexpr auto kPatience = std::chrono::seconds(20);

bool becomes(const std::atomic<int>& value, int wanted) {
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (value < wanted) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::yield();
  }
  return true;
}

// A caller comes while another one's loop is in the arena, which then ends: from there on both of the arena's threads
// are his.
TEST(Parallel, SecondLoopGetsAllThreadsAfterTheFirst) {
  if (tbb::this_task_arena::max_concurrency() < 2) GTEST_SKIP() << "one core";
  tbb::task_arena arena(2);
  std::promise<void> first_is_in, second_is_in;
  std::thread first([&] {
    in_arena(arena, [&] {
      in_parallel(1, [&](std::size_t) {
        first_is_in.set_value();
        second_is_in.get_future().wait_for(kPatience);
      });
    });
  });
  first_is_in.get_future().wait();
  in_arena(arena, [&] {
    in_parallel(1, [&](std::size_t) { second_is_in.set_value(); });
    first.join();
    for (int loop = 0; loop < 20; ++loop) {
      std::atomic<int> here{0};
      std::atomic<bool> met{true};
      in_parallel(2, [&](std::size_t) {
        ++here;
        if (!becomes(here, 2)) met = false;
      });
      ASSERT_TRUE(met) << "loop " << loop << " had one thread";
    }
  });
}

TEST(Parallel, NestedLoopsAndExceptions) {
  tbb::task_arena arena(2);
  std::atomic<int> sum{0};
  in_arena(arena, [&] {
    in_parallel(10,
                [&](std::size_t i) { in_parallel(10, [&](std::size_t k) { sum += static_cast<int>(10 * i + k); }); });
    EXPECT_THROW(in_parallel(10,
                             [](std::size_t i) {
                               if (i == 7) throw std::out_of_range("7");
                             }),
                 std::out_of_range);
    in_parallel(2, [&](std::size_t) { ++sum; });
  });
  EXPECT_EQ(sum, 99 * 100 / 2 + 2);
}

// What has begun when another piece throws is done as a whole, or it would be taken for whole: a block of terrain, say,
// whose posts nobody has read.
TEST(Parallel, NestedLoopOfACancelledLoopCompletes) {
  if (tbb::this_task_arena::max_concurrency() < 2) GTEST_SKIP() << "one core";
  tbb::task_arena arena(2);
  std::atomic<int> within{0}, begun{0};
  std::atomic<bool> given_up{false};
  in_arena(arena, [&] {
    EXPECT_THROW(in_parallel(2,
                             [&](std::size_t i) {
                               ++begun;
                               ASSERT_TRUE(becomes(begun, 2));
                               if (i == 0) throw std::out_of_range("0");
#ifndef __SANITIZE_THREAD__
                               const auto end = std::chrono::steady_clock::now() + kPatience;
                               while (!tbb::is_current_task_group_canceling() && std::chrono::steady_clock::now() < end)
                                 std::this_thread::yield();
                               given_up = tbb::is_current_task_group_canceling();
#endif
                               in_parallel(100, [&](std::size_t) { ++within; });
                             }),
                 std::out_of_range);
  });
#ifndef __SANITIZE_THREAD__
  EXPECT_TRUE(given_up);
#endif
  EXPECT_EQ(within, 100);
}

}  // namespace
}  // namespace selenograph
