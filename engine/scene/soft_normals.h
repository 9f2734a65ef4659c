// Shading normals at borders between levels of detail. The finer level shows an octave of sizes more than the coarser
// one, and the end of that octave would show as an edge. At the border the finer block's normals are smoothed like the
// coarser level's; over the block they blend into its own.
#pragma once

#include <cstdint>
#include <span>

#include "dem/grid/block.h"

namespace selenograph::engine {

// Corners of a block, a bit each: south-west, south-east, north-west, north-east.
using Corners = std::uint8_t;
inline constexpr int kCorners = 4;

// Smooths the normals of a block at some corners. `vertices`: side x side, row 0 in the south. `smooth`: corners with
// smoothed normals; at the others normals stay unchanged, in between they are blended bilinearly. Blocks of one level
// that agree on their shared corners agree on the normals of common edges, bit for bit.
void soften_normals(std::span<dem::Vertex> vertices, int side, Corners smooth);

}  // namespace selenograph::engine
