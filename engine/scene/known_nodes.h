// Height bounds of quadtree nodes, and which nodes can be judged without their pyramid.
#pragma once

#include <optional>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {

struct Known {
  dem::NodeInfo info;
  NodeBounds bounds;
  bool loose = false;  // bounds of all lunar relief, no error
};

// Nodes of these levels are first judged with the bounds of all lunar relief: if they cannot matter even then, no
// pyramid is read or built for them. Only nodes that may be the root of a pyramid are judged this way; for finer ones
// such bounds say nothing.
inline constexpr int kLooseLevels = 8;

inline NodeBounds loose_bounds(const dem::BlockId& id) {
  return bounds_of_all(id, static_cast<double>(dem::kLowestRelief_m), static_cast<double>(dem::kHighestRelief_m));
}

inline NodeBounds bounds_within(const dem::BlockId& id, const dem::NodeInfo& heights) {
  return bounds_of(id, static_cast<double>(heights.min_m), static_cast<double>(heights.max_m));
}

// Judges a node without building a pyramid. Returns false when it cannot matter whatever its heights are, or given the
// heights that its files hold. `matters` must be monotonic: true for wider bounds if it is true for narrower ones, so
// that answers do not depend on what has been built.
template <typename Matters>
bool may_matter(const dem::Terrain& terrain, const dem::BlockId& id, const StopToken& stop, const Matters& matters) {
  if (id.level > kLooseLevels) return true;
  if (!matters(loose_bounds(id))) return false;
  // Files are looked at only where level ground, as low as the maria, would not matter.
  constexpr double kMaria_m = -2000;
  if (!terrain.has_data(id) || matters(bounds_of(id, kMaria_m, kMaria_m))) return true;
  const auto range = terrain.heights_without_building(id, stop);
  return !range || matters(bounds_of_all(id, static_cast<double>(range->low), static_cast<double>(range->high)));
}

// Heights of a node, or the bounds of all lunar relief where the true ones would require building everything below.
inline std::optional<Known> known(const dem::Terrain& terrain, const dem::BlockId& id, const StopToken& stop) {
  if (!terrain.has_data(id)) return std::nullopt;
  dem::NodeInfo info{0, dem::kLowestRelief_m, dem::kHighestRelief_m, false, {}};
  const bool cheap = terrain.node_is_cheap(id);
  if (cheap) info = terrain.node(id, stop);
  if (info.empty) return std::nullopt;
  return Known{info, bounds_within(id, info), !cheap};
}

}  // namespace selenograph::engine
