// Heights for reliefs (relief.h) from a terrain's blocks.
#pragma once

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/relief/relief.h"

namespace selenograph::engine {

// Returns heights from the level whose posts are as close as the relief's, or from the finest existing one, linear in
// its triangles. The arguments must outlive the function.
ReliefHeights heights_of(const dem::Terrain& terrain, const StopToken& stop);

}  // namespace selenograph::engine
