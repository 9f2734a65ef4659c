#include <gtest/gtest.h>

#include <random>
#include <utility>
#include <vector>

#include "dem/posts/post_window.h"

namespace selenograph::dem {
namespace {

TEST(SourceRows, HoldsEveryMark) {
  std::mt19937 random(3);
  SourceRows rows;
  for (const int columns : {1, 2, 15, 16, 17, 64, 100}) {
    rows.reset(40, columns);
    for (int r = 0; r < 40; ++r) {
      // From one source for all to another one for each, voids and filled posts among them.
      std::vector<SourceMark> marks(static_cast<std::size_t>(columns), kNoSource);
      for (SourceMark& mark : marks)
        if (&mark == marks.data() || random() % 40 < static_cast<unsigned>(r))
          mark = random() % 5 == 0 ? kNoSource : (random() % 3) | (random() % 2 ? kFilledBit : 0);
        else
          mark = *(&mark - 1);
      rows.set(r, marks.data());
      std::vector<SourceMark> back(marks.size());
      rows.expand(r, back.data());
      EXPECT_EQ(back, marks);
      for (int c = 0; c < columns; ++c) EXPECT_EQ(rows.mark(r, c), marks[static_cast<std::size_t>(c)]);
      SourceMark before = marks[0] + 1;
      for (const SourceRun& run : rows.row(r)) EXPECT_NE(std::exchange(before, run.mark), run.mark) << "one run";
    }
  }
}

TEST(SourceRows, RunsAreAppended) {
  SourceRows rows;
  rows.reset(1, 10);
  rows.clear(0);
  rows.append(0, 7, 0);  // nothing
  rows.append(0, 7, 4);
  rows.append(0, 7, 5);
  rows.append(0, 8, 5);  // nothing
  rows.append(0, 9, 10);
  ASSERT_EQ(rows.row(0).size(), 2U);
  EXPECT_EQ(rows.mark(0, 4), 7U);
  EXPECT_EQ(rows.mark(0, 5), 9U);
}

}  // namespace
}  // namespace selenograph::dem
