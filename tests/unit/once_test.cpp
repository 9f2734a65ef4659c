#include "dem/base/once.h"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

namespace selenograph::dem {
namespace {

TEST(Once, NextCallerRetriesAfterAnException) {
  Once once;
  int tried = 0;
  const auto work = [&] {
    if (++tried < 3) throw std::runtime_error("not yet");
  };
  EXPECT_THROW(once.run(work), std::runtime_error);
  EXPECT_THROW(once.run(work), std::runtime_error);
  once.run(work), once.run(work);
  EXPECT_EQ(tried, 3);
}

TEST(Once, AllCallersWaitUntilDone) {
  Once once;
  int made = 0;  // ThreadSanitizer would see whoever reads it too early
  std::atomic<int> right = 0;
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i)
    threads.emplace_back([&] {
      once.run([&] {
        std::this_thread::yield();
        ++made;
      });
      right += made == 1;
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(right, 8);
}

}  // namespace
}  // namespace selenograph::dem
