// What is known of the quadtree's nodes, and which of them need no look into a pyramid.
#pragma once

#include <optional>

#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {

struct Known {
  dem::NodeInfo info;
  NodeBounds bounds;
};

// Of lunar relief. What can't matter even so needs no look into a pyramid, which may have to be built first. Only asked
// of nodes that may be the root of one, whatever has been built: of finer ones such bounds say nothing.
inline constexpr int kLooseLevels = 8;

inline NodeBounds loose_bounds(const dem::BlockId& id) {
  return bounds_of_all(id, static_cast<double>(dem::kLowestRelief_m), static_cast<double>(dem::kHighestRelief_m));
}

inline NodeBounds bounds_within(const dem::BlockId& id, const dem::NodeInfo& heights) {
  return bounds_of(id, static_cast<double>(heights.min_m), static_cast<double>(heights.max_m));
}

// What of a node needs no pyramid, or no more than is there: false when it can't matter whatever its heights are, or
// those that its files hold. `matters` must be true of wider bounds where it is of narrower ones, so that answers don't
// depend on what has been built.
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

// Heights of a node; lunar relief's own bounds where the true ones would cost building everything beneath.
inline std::optional<Known> known(const dem::Terrain& terrain, const dem::BlockId& id, const StopToken& stop) {
  if (!terrain.has_data(id)) return std::nullopt;
  dem::NodeInfo info{0, dem::kLowestRelief_m, dem::kHighestRelief_m, false, {}};
  if (terrain.node_is_cheap(id)) info = terrain.node(id, stop);
  if (info.empty) return std::nullopt;
  return Known{info, bounds_within(id, info)};
}

}  // namespace selenograph::engine
