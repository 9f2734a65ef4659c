// Which blocks rays need.
#pragma once

#include <optional>
#include <vector>

#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/queries.h"

namespace selenograph::engine {

// The finest blocks that rays may meet, or pass so far above, sorted, and for each of them which rays; empty when they
// are more than max_blocks. Neighbours can differ in level where sources do: the mesh joins them all the same.
struct BlockOnRays {
  dem::BlockId id;
  double low_m, high_m;           // that its terrain lies between
  std::vector<std::size_t> rays;  // ascending
};
std::optional<std::vector<BlockOnRays>> select_for_rays(const dem::Terrain& terrain, const std::vector<Ray>& rays,
                                                        std::size_t max_blocks, const StopToken& stop,
                                                        double above_m = 0);

}  // namespace selenograph::engine
