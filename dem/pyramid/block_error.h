// Errors of a chunk's blocks against its finest posts, and their height ranges.
#pragma once

#include <algorithm>
#include <limits>
#include <unordered_map>
#include <vector>

#include "dem/pyramid/octave_grid.h"

namespace selenograph::dem {

// For a block: largest vertical distance between its triangles and the finest surface; lowest and highest height of
// both. None: low > high. The finest surface has the base posts; of a base coarser than kSmoothLevel it has the posts
// of the base's blocks, which are farther apart beside a pole.
struct Extremes {
  float error_m = 0, low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
  void add(const Extremes& other) {
    error_m = std::max(error_m, other.error_m), low = std::min(low, other.low), high = std::max(high, other.high);
  }
};

using Measured = std::unordered_map<BlockId, Extremes, BlockIdHash>;

// Measures all blocks of all levels. `levels`: from fine to coarse.
Measured measure(const ChunkPlan& plan, const OctaveGrid& base, const std::vector<OctaveGrid>& levels,
                 const StopToken& stop);

}  // namespace selenograph::dem
