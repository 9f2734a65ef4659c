// Root blocks of the quadtree, grouped by region: a group out of view is skipped at once, so that a frame's cost does
// not grow with terrain that it does not show.
#pragma once

#include <algorithm>
#include <vector>

#include "dem/terrain/terrain.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {

struct RootGroup {
  int first_row, past_last_row;
  std::vector<int> first_column, past_last_column;  // per row
  NodeBounds bounds;                                // bounds of everything its blocks can contain
};

// Returns a partition of all blocks of level 0, the same for every terrain.
const std::vector<RootGroup>& root_groups();

// Calls visit(id) for each of the group's blocks that has data, ascending.
template <typename Visit>
void for_each_root(const dem::Terrain& terrain, const RootGroup& group, const Visit& visit) {
  const std::vector<dem::BlockId>& roots = terrain.roots();  // ascending
  for (int row = group.first_row; row < group.past_last_row; ++row) {
    const auto i = static_cast<std::size_t>(row - group.first_row);
    const dem::BlockId end{0, row, group.past_last_column[i]};
    for (auto root = std::lower_bound(roots.begin(), roots.end(), dem::BlockId{0, row, group.first_column[i]});
         root != roots.end() && *root < end; ++root)
      visit(*root);
  }
}

}  // namespace selenograph::engine
