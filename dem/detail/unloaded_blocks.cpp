#include "dem/detail/unloaded_blocks.h"

#include "dem/detail/detailed_terrain.h"

namespace selenograph::dem {
namespace {

// Returns the terrain as an overlay; null if it is the plain or the detailed terrain itself.
const TerrainOverlay* overlay_of(const Terrain& terrain) {
  if (&terrain == &terrain.plain() || &terrain == terrain.detailed()) return nullptr;
  return dynamic_cast<const TerrainOverlay*>(&terrain);
}

}  // namespace

bool has_detail(const Terrain& terrain, const BlockId& id) {
  if (const auto* overlay = overlay_of(terrain)) return overlay->has_detail(id);
  return terrain.detailed() && terrain.detailed()->has_detail(id);
}

bool node_is_cheap(const Terrain& terrain, const BlockId& id) {
  if (const auto* overlay = overlay_of(terrain)) return overlay->node_is_cheap(id);
  return terrain.plain().node_is_cheap(id) || has_detail(terrain, id);
}

std::optional<NodeInfo> outline(const Terrain& terrain, const BlockId& id, const StopToken& stop) {
  if (const auto* overlay = overlay_of(terrain)) return overlay->outline(id, stop);
  return terrain.detailed() ? terrain.detailed()->outline(id, stop) : std::nullopt;
}

std::optional<HeightRange> heights_without_building(const Terrain& terrain, const BlockId& id, const StopToken& stop) {
  if (const auto* overlay = overlay_of(terrain)) return overlay->heights_without_building(id, stop);
  return terrain.detailed() ? terrain.detailed()->heights_without_building(id, stop)
                            : terrain.plain().heights_without_building(id, stop);
}

}  // namespace selenograph::dem
