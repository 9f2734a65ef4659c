// Shading normals where levels of detail meet: the finer level shows an octave of sizes more than the coarser one,
// whose end would be seen as an edge. Beside it, the finer block's normals are smoothed as the coarser level's are;
// over the block they go over into its own.
#pragma once

#include <cstdint>
#include <span>

#include "dem/grid/block.h"

namespace selenograph::engine {

// Corners of a block, a bit each: south-west, south-east, north-west, north-east.
using Corners = std::uint8_t;
inline constexpr int kCorners = 4;

// `vertices`: side x side of a block, row 0 in the south. `smooth`: corners at which normals are smoothed; at the
// others they stay as they are, in between they are blended bilinearly. Blocks of one level that agree on the corners
// that they share agree on the normals of common edges, bit for bit.
void soften_normals(std::span<dem::Vertex> vertices, int side, Corners smooth);

}  // namespace selenograph::engine
