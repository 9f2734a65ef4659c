// The depot's contract: one load per key in flight, least recently used goes first, what is in use stays, failures are
// not remembered.
#include "dem/base/cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

namespace selenograph::dem {
namespace {

using Depot = Cache<int, int>;

Depot::Loaded made(int value, std::size_t bytes) { return {std::make_shared<const int>(value), bytes}; }

// Loads and lets go at once. True when it had to be loaded.
bool touch(Depot& depot, int key, std::size_t bytes) {
  bool loaded = false;
  const auto value = depot.get(key, [&] {
    loaded = true;
    return made(key, bytes);
  });
  EXPECT_EQ(*value, key);
  return loaded;
}

TEST(Cache, ManyThreadsOneLoad) {
  Depot depot(1000);
  std::atomic<int> loads{0}, started{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 16; ++i)
    threads.emplace_back([&] {
      ++started;
      const auto value = depot.get(1, [&] {
        ++loads;
        while (started < 16) std::this_thread::yield();
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        return made(42, 1);
      });
      EXPECT_EQ(*value, 42);
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(loads, 1);
  EXPECT_EQ(depot.misses(), 1U);
  EXPECT_EQ(depot.hits(), 15U);
}

TEST(Cache, DifferentKeysLoadAtTheSameTime) {
  Depot depot(1000);
  std::atomic<int> inside{0};
  const auto load = [&](int key) {
    depot.get(key, [&] {
      ++inside;
      const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(10);
      while (inside < 2 && std::chrono::steady_clock::now() < limit) std::this_thread::yield();
      return made(key, 1);
    });
  };
  std::thread other([&] { load(1); });
  load(2);
  other.join();
  EXPECT_EQ(inside, 2);
}

TEST(Cache, LeastRecentlyUsedGoesFirst) {
  Depot depot(30);
  for (const int key : {1, 2, 3}) EXPECT_TRUE(touch(depot, key, 10));
  EXPECT_FALSE(touch(depot, 1, 10));  // 2 is now the oldest
  EXPECT_TRUE(touch(depot, 4, 10));
  // A value that has just been loaded is held by its loader, so the eviction happens before: 2 is gone, the rest is
  // here.
  EXPECT_FALSE(touch(depot, 3, 10));
  EXPECT_FALSE(touch(depot, 1, 10));
  EXPECT_FALSE(touch(depot, 4, 10));
  EXPECT_EQ(depot.evictions(), 1U);
  EXPECT_TRUE(touch(depot, 2, 10));
}

TEST(Cache, BytesStayWithinTheBudget) {
  Depot depot(100);
  for (int key = 0; key < 1000; ++key) {
    touch(depot, key, 7);
    ASSERT_LE(depot.bytes(), 100U);
  }
  EXPECT_EQ(depot.bytes(), 98U);
  EXPECT_EQ(depot.evictions(), 1000U - 14);
}

TEST(Cache, EntriesInUseAreKept) {
  Depot depot(30);
  const auto held = depot.get(1, [] { return made(1, 20); });
  for (const int key : {2, 3, 4}) touch(depot, key, 10);
  EXPECT_FALSE(touch(depot, 1, 20));
  EXPECT_EQ(*held, 1);
}

TEST(Cache, EntriesBeyondTheBudgetAreDroppedOnRelease) {
  Depot depot(30);
  {
    const auto held = depot.get(1, [] { return made(1, 500); });
    EXPECT_EQ(*held, 1);
  }
  touch(depot, 2, 10);
  EXPECT_EQ(depot.bytes(), 10U);
}

TEST(Cache, WhatIsInUseLeavesRoomForWhatIsNeededNext) {
  Depot depot(100, {}, 30);
  std::vector<Depot::Pointer> held;
  for (int key = 100; key < 120; ++key) held.push_back(depot.get(key, [&] { return made(key, 10); }));
  for (const int key : {1, 2, 3}) EXPECT_TRUE(touch(depot, key, 10));
  for (int again = 0; again < 5; ++again)
    for (const int key : {1, 2, 3}) EXPECT_FALSE(touch(depot, key, 10));
  EXPECT_LE(depot.bytes(), 200U + 30);
  EXPECT_TRUE(touch(depot, 4, 10));
  touch(depot, 5, 10);
  EXPECT_TRUE(touch(depot, 1, 10));
  held.clear();
  for (const int key : {6, 7}) touch(depot, key, 10);
  EXPECT_LE(depot.bytes(), 100U);
}

TEST(Cache, EvictionIsNotStoppedByManyInUse) {
  Depot depot(1000);
  touch(depot, 0, 500);
  std::vector<Depot::Pointer> held;
  for (int key = 1; key <= 2000; ++key) held.push_back(depot.get(key, [&] { return made(key, 1); }));
  EXPECT_FALSE(depot.holds(0));
  for (int key = 3000; key < 3100; ++key) touch(depot, key, 10);
  EXPECT_LE(depot.bytes(), 2000U + 10 * (2 + 2000 / 256));  // it looks at so many at a time
}

TEST(Cache, FailuresAreRetried) {
  Depot depot(30);
  int attempts = 0;
  const auto load = [&]() -> Depot::Loaded {
    if (++attempts < 3) throw std::runtime_error("disk");
    return made(5, 1);
  };
  EXPECT_THROW(depot.get(1, load), std::runtime_error);
  EXPECT_THROW(depot.get(1, load), std::runtime_error);
  EXPECT_EQ(*depot.get(1, load), 5);
  EXPECT_EQ(attempts, 3);
}

TEST(Cache, FailureReachesAllWaiters) {
  Depot depot(30);
  std::atomic<int> loads{0}, failures{0}, started{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i)
    threads.emplace_back([&] {
      ++started;
      try {
        depot.get(1, [&]() -> Depot::Loaded {
          ++loads;
          while (started < 8) std::this_thread::yield();
          std::this_thread::sleep_for(std::chrono::milliseconds(20));
          throw std::runtime_error("disk");
        });
      } catch (const std::runtime_error&) {
        ++failures;
      }
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(failures, 8);
  EXPECT_LE(loads, 8);
  EXPECT_TRUE(touch(depot, 1, 1)) << "the failure was remembered";
}

TEST(Cache, WaitersHaveTheirOwnStopTokens) {
  Depot depot(30);
  std::atomic<bool> waited{false};
  std::thread loader([&] {
    depot.get(1, [&] {
      const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(10);
      while (!waited && std::chrono::steady_clock::now() < limit) std::this_thread::yield();
      return made(5, 1);
    });
  });
  while (depot.misses() == 0) std::this_thread::yield();
  const auto start = StopToken::Clock::now();
  const auto get = [&](const StopToken& stop) {
    return depot.get(
        1, [] { return made(6, 1); }, stop);
  };
  EXPECT_THROW(get(StopToken(start + std::chrono::milliseconds(30))), Cancelled);
  const std::atomic<bool> left{true};
  EXPECT_THROW(get(StopToken(StopToken::Clock::time_point::max(), &left)), Cancelled);
  EXPECT_LT(StopToken::Clock::now() - start, std::chrono::seconds(2));
  waited = true;
  loader.join();
  EXPECT_EQ(*get({}), 5);
  EXPECT_EQ(depot.misses(), 1U);
}

TEST(Cache, CancelledLoadFailsNobodyElse) {
  Depot depot(30);
  std::atomic<int> loads{0}, started{0}, got{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i)
    threads.emplace_back([&] {
      ++started;
      try {
        const auto value = depot.get(1, [&]() -> Depot::Loaded {
          while (started < 8) std::this_thread::yield();
          std::this_thread::sleep_for(std::chrono::milliseconds(20));
          if (++loads <= 3) throw Cancelled();
          return made(5, 1);
        });
        got += *value == 5;
      } catch (const Cancelled&) {
      }
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(loads, 4);
  EXPECT_EQ(got, 5);  // all but the three that gave up themselves
}

TEST(Cache, MissingEntriesAreCached) {
  Depot depot(30);
  int loads = 0;
  for (int i = 0; i < 3; ++i)
    EXPECT_EQ(depot.get(1,
                        [&] {
                          ++loads;
                          return Depot::Loaded{nullptr, 1};
                        }),
              nullptr);
  EXPECT_EQ(loads, 1);
}

TEST(Cache, ErasedEntriesAreReloaded) {
  Depot depot(30);
  touch(depot, 1, 10);
  depot.erase(1);
  depot.erase(77);
  EXPECT_EQ(depot.bytes(), 0U);
  EXPECT_TRUE(touch(depot, 1, 10));
}

}  // namespace
}  // namespace selenograph::dem
