// Regions of the quadtree's first blocks: every block is in one, and inside its ball.
#include "engine/scene/root_groups.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

TEST(RootGroups, HoldEachBlockOnceAndAllThatIsInIt) {
  std::set<dem::BlockId> met;
  for (const RootGroup& group : root_groups())
    for (int row = group.first_row; row < group.past_last_row; ++row) {
      const auto i = static_cast<std::size_t>(row - group.first_row);
      for (int col = group.first_column[i]; col < group.past_last_column[i]; ++col) {
        EXPECT_TRUE(met.insert({0, row, col}).second);
        for (const auto& [low, high] : {std::pair(-12000.0, 13000.0), std::pair(-12000.0, -11999.0),
                                        std::pair(0.0, 1.0), std::pair(12999.0, 13000.0)}) {
          const NodeBounds b = bounds_of({0, row, col}, low, high);
          EXPECT_LE((b.centre - group.bounds.centre).norm() + b.radius_m, group.bounds.radius_m);
          EXPECT_LE(high, group.bounds.high_m);
        }
      }
    }
  std::size_t all = 0;
  for (int row = 0; row < dem::rows_of(0); ++row) all += static_cast<std::size_t>(dem::columns_of(0, row));
  EXPECT_EQ(met.size(), all);
}

TEST(RootGroups, GiveTheBlocksThatHaveData) {
  test::TemporaryFolder folder;
  test::write_float_tile(folder.path(), "a", {3, 20, 8, 25, 65}, [](double, double) { return 1.0; });
  test::write_float_tile(folder.path(), "b", {90, -180, 8, 17, 2880}, [](double, double) { return 2.0; });
  test::write_float_tile(folder.path(), "c", {-80, 178, 8, 9, 32}, [](double, double) { return 3.0; });
  const dem::PyramidTerrain terrain(dem::Catalogue(std::vector<std::string>{folder.path()}), {});
  std::multiset<dem::BlockId> met;
  for (const RootGroup& group : root_groups())
    for_each_root(terrain, group, [&](const dem::BlockId& id) { met.insert(id); });
  EXPECT_GT(met.size(), 10U);
  EXPECT_TRUE(std::equal(met.begin(), met.end(), terrain.roots().begin(), terrain.roots().end()));
}

}  // namespace
}  // namespace selenograph::engine
