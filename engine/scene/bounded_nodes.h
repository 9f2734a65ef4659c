// Bounds of quadtree nodes, and the tests that need no pyramid.
#pragma once

#include <optional>

#include "dem/base/stop_token.h"
#include "dem/detail/unloaded_blocks.h"
#include "dem/terrain/terrain.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {

// Heights of a node, and the bounds that follow from them.
struct BoundedNode {
  dem::NodeInfo info;
  NodeBounds bounds;
  bool loose = false;  // heights and bounds are those of all lunar relief; no error is known
};

// Nodes up to this level are first tested with the bounds of all lunar relief: a node that cannot matter even then
// needs no pyramid. Only nodes that may be the root of a pyramid are tested so; for finer ones such bounds are useless.
inline constexpr int kLooseLevels = 8;

inline NodeBounds loose_bounds(const dem::BlockId& id) {
  return bounds_of_all(id, static_cast<double>(dem::kLowestRelief_m), static_cast<double>(dem::kHighestRelief_m));
}

inline NodeBounds bounds_within(const dem::BlockId& id, const dem::NodeInfo& heights) {
  return bounds_of(id, static_cast<double>(heights.min_m), static_cast<double>(heights.max_m));
}

// Tests a node without building a pyramid. Returns false if it cannot matter whatever its heights are, or with the
// range of heights in its files. `matters` must be monotonic, true for wider bounds if true for narrower ones, so that
// answers do not depend on what has been built.
template <typename Matters>
bool may_matter(const dem::Terrain& terrain, const dem::BlockId& id, const StopToken& stop, const Matters& matters) {
  if (id.level > kLooseLevels) return true;
  if (!matters(loose_bounds(id))) return false;
  // Survey the files only if level ground as low as the maria would not matter.
  constexpr double kMaria_m = -2000;
  if (!terrain.has_data(id) || matters(bounds_of(id, kMaria_m, kMaria_m))) return true;
  const auto range = dem::heights_without_building(terrain, id, stop);
  return !range || matters(bounds_of_all(id, static_cast<double>(range->low), static_cast<double>(range->high)));
}

// Returns a node with its heights, or with the bounds of all lunar relief if its heights would require building
// everything below. Empty without data.
inline std::optional<BoundedNode> bounded_node(const dem::Terrain& terrain, const dem::BlockId& id,
                                               const StopToken& stop) {
  if (!terrain.has_data(id)) return std::nullopt;
  dem::NodeInfo info{0, dem::kLowestRelief_m, dem::kHighestRelief_m, false, {}};
  const bool cheap = dem::node_is_cheap(terrain, id);
  if (cheap) info = terrain.node(id, stop);
  if (info.empty) return std::nullopt;
  return BoundedNode{info, bounds_within(id, info), !cheap};
}

}  // namespace selenograph::engine
