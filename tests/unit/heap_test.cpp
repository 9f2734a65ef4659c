#include "engine/support/heap.h"

#include <gtest/gtest.h>

#include <vector>

namespace selenograph::engine {
namespace {

constexpr std::size_t kMebi = std::size_t{1} << 20;

// Small arrays are cut from what was touched as a whole: the system isn't asked again.
TEST(Heap, WhatWasTouchedIsUsedFirst) {
  if (heap_statistics().used_bytes == 0) GTEST_SKIP() << "a heap that can't tell";
  give_back_free_memory();
  ASSERT_TRUE(touch_memory(256 * kMebi));
  const HeapStatistics before = heap_statistics();
  EXPECT_GE(before.free_bytes, 250 * kMebi);
  std::vector<std::vector<char>> arrays;
  for (int i = 0; i < 2000; ++i) arrays.emplace_back(80 << 10);
  const HeapStatistics now = heap_statistics();
  EXPECT_GE(now.used_bytes, before.used_bytes + 150 * kMebi);
  EXPECT_LE(now.free_bytes, before.free_bytes - 150 * kMebi);
  arrays.clear();
  EXPECT_GE(heap_statistics().free_bytes, 250 * kMebi) << "nothing is given back unasked";
  give_back_free_memory();
  EXPECT_LT(heap_statistics().free_bytes, 16 * kMebi);
}

}  // namespace
}  // namespace selenograph::engine
