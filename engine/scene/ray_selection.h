// Selects the blocks that rays, or bundles of them, need.
#pragma once

#include <optional>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/queries.h"

namespace selenograph::engine {

// Along the axis, to where all of a cone is below any terrain: what it meets, it meets before. Infinite: nowhere, or it
// begins there. Else a ray into the ground would be followed to where it leaves the Moon again.
double range_below_terrain_m(const RayCone& ray);

// The finest blocks that rays may hit, or pass within a height above, sorted, each with its rays; empty when there are
// more than max_blocks. Blocks with detail are no finer than `finest_detail`. Neighbours may differ by more than one
// level where sources differ: the mesh joins them all the same.
struct BlockOnRays {
  dem::BlockId id;
  double low_m, high_m;           // height bounds of its terrain
  std::vector<std::size_t> rays;  // ascending
};
std::optional<std::vector<BlockOnRays>> select_for_rays(const dem::Terrain& terrain, const std::vector<RayCone>& rays,
                                                        std::size_t max_blocks, const StopToken& stop,
                                                        double above_m = 0, int finest_detail = dem::kMaxLevel);

}  // namespace selenograph::engine
