// Errors of a chunk's blocks against its finest posts, and their height ranges.
//
//     o-------------o     o  posts of the block: its triangles are straight between them
//       .    |    .       .  posts of the finest surface
//          . | .          |  error_m: the largest vertical distance between the two
#pragma once

#include <algorithm>
#include <limits>
#include <unordered_map>
#include <vector>

#include "dem/pyramid/octave_grid.h"

namespace selenograph::dem {

// A block's largest vertical distance between its triangles and the finest surface, and the lowest and highest height
// of both; low > high if there is no height. The finest surface has the base posts. If the base is coarser than
// kSmoothLevel, it has the posts of the base's blocks, which are farther apart near a pole.
struct Extremes {
  float error_m = 0, low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
  void add(const Extremes& extremes) {
    error_m = std::max(error_m, extremes.error_m);
    low = std::min(low, extremes.low);
    high = std::max(high, extremes.high);
  }
};

using BlockExtremes = std::unordered_map<BlockId, Extremes, BlockIdHash>;

// Returns the extremes of all blocks of all levels. `levels`: from fine to coarse.
BlockExtremes measure_blocks(const ChunkPlan& plan, const OctaveGrid& base, const std::vector<OctaveGrid>& levels,
                             const StopToken& stop);

}  // namespace selenograph::dem
