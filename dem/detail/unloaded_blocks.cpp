#include "dem/detail/unloaded_blocks.h"

#include "dem/detail/detailed_terrain.h"

namespace selenograph::dem {

bool has_detail(const Terrain& terrain, const BlockId& id) {
  return terrain.detailed() && terrain.detailed()->has_detail(id);
}

bool node_is_cheap(const Terrain& terrain, const BlockId& id) {
  return terrain.plain().node_is_cheap(id) || has_detail(terrain, id);
}

std::optional<NodeInfo> outline(const Terrain& terrain, const BlockId& id, const StopToken& stop) {
  return terrain.detailed() ? terrain.detailed()->outline(id, stop) : std::nullopt;
}

std::optional<HeightRange> heights_without_building(const Terrain& terrain, const BlockId& id, const StopToken& stop) {
  return terrain.detailed() ? terrain.detailed()->heights_without_building(id, stop)
                            : terrain.plain().heights_without_building(id, stop);
}

}  // namespace selenograph::dem
