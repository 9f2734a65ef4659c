// Shading normals at borders between levels of detail. The finer level shows an octave of sizes more than the coarser
// one, and the end of that octave would show as an edge. At the border the finer block's normals are smoothed like the
// coarser level's; over kSoftBlocks blocks they blend into their own:
//
//   coarser level |     finer level, blocks
//        |        3-----------2-----------1-----------0-----------0   kSoftBlocks = 3: shares at corners, in thirds
//        |        |           |           |           |           |
#pragma once

#include <cstdint>
#include <span>

#include "dem/grid/block.h"

namespace selenograph::engine {

// Share of smoothed normals at each corner of a block, in 1 / kSoftBlocks, two bits each: south-west, south-east,
// north-west, north-east.
using Corners = std::uint8_t;
inline constexpr int kCorners = 4, kSoftBlocks = 3;
inline int share_at(Corners corners, int corner) { return corners >> (2 * corner) & 3; }
// Returns the corners with at least that share at one of them.
inline Corners raised(Corners corners, int corner, int share) {
  return share <= share_at(corners, corner)
             ? corners
             : static_cast<Corners>((corners & ~(3 << (2 * corner))) | share << (2 * corner));
}

// Blends the normals of a block into smoothed ones. `vertices`: side x side, row 0 in the south. `shares`: of the
// smoothed normals at the corners, bilinear in between. Blocks of one level that agree on their shared corners agree on
// the normals of common edges, bit for bit.
void soften_normals(std::span<dem::Vertex> vertices, int side, Corners shares);

}  // namespace selenograph::engine
