// Tells what is known of a block before it is loaded. Selection asks this first, so that nothing is built or made that
// cannot matter.
//
//   has_detail?  no: the pyramid knows it      node_is_cheap?  no: heights_without_building, a survey of the files
//                yes: it has to be made        outline, from coarser ground or from posts
#pragma once

#include <optional>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"

namespace selenograph::dem {

// Terrain made from another terrain: it knows itself what the functions below tell.
class TerrainOverlay : public Terrain {
 public:
  virtual bool has_detail(const BlockId& id) const = 0;
  virtual bool node_is_cheap(const BlockId& id) const = 0;
  virtual std::optional<NodeInfo> outline(const BlockId& id, const StopToken& stop) const = 0;
  virtual std::optional<HeightRange> heights_without_building(const BlockId& id, const StopToken& stop) const = 0;
};

// Returns whether a block has detail: it is finer than the distance that its posts resolve, and is made when needed.
bool has_detail(const Terrain& terrain, const BlockId& id);

// Returns whether Terrain::node() needs only sources around the block itself. Otherwise (a coarse block over very fine
// posts) it first builds everything below: call it only if the block is really needed.
bool node_is_cheap(const Terrain& terrain, const BlockId& id);

// Returns, without making a block with detail, wider bounds on its heights and a lower bound on its error. Empty if
// Terrain::node() makes no block either, and if no bounds are available. Whether a block has an outline depends on the
// terrain only, not on the caches, so that selection is reproducible.
std::optional<NodeInfo> outline(const Terrain& terrain, const BlockId& id, const StopToken& stop);

// Returns, if Terrain::node() would have to build first, wider bounds on the heights of the block and everything below,
// from a scan of the files. Empty if it need not build, or if a scan gives no bounds.
std::optional<HeightRange> heights_without_building(const Terrain& terrain, const BlockId& id, const StopToken& stop);

}  // namespace selenograph::dem
