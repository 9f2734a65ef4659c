// Smooth shading normals from posts.
//
// Integer metres quantise slopes: 1 m in 7.4 m is 7.7 degrees, and normals from raw neighbour differences show
// terraces. The slope at a post is therefore the least-squares plane through the posts around it (Savitzky & Golay
// 1964): 3 x 3, or 5 x 5 where quantisation would leave more than kQuantisationSlope of noise (standard deviation) in
// the 3 x 3 plane. Vertices keep the posts' heights: only shading is smoothed.
//
// This applies where vertices are posts. Heights of a filtered level are already smoothed by the pyramid's low-pass,
// and normals are smoothed again by interpolation between vertices. A plane through 3 x 3 vertices would smooth a third
// time: at one post per pixel that was most of the radiance error. Slopes of a filtered level are therefore differences
// along the row and the column of a vertex only, with weights (1, -6, 0, 6, -1) / 8. Such a difference has the
// frequency response 1 + w^2 / 12 + O(w^4); to second order it inverts the low-pass, whose variance tends to 1/6 of a
// squared post spacing. Measured on interpolated heights of Hadley, this is as accurate as the mean of the finest
// posts' slopes over each vertex's cell, which would have to be stored.
#pragma once

#include <span>

#include "dem/grid/block.h"

namespace selenograph::dem {

inline constexpr int kHalo = 2;                     // posts around the block that stencils may read
inline constexpr double kQuantisationSlope = 0.01;  // 0.6 degrees

// Kind of a block's heights: posts as in their files, in steps of `quantisation_m`, or a filtered level. They are above
// `base_m`: near to it, float resolves the slopes of posts a millimetre apart.
struct HeightsKind {
  bool filtered = false;
  double quantisation_m = 0;
  double base_m = 0;
};

// Fills the normals of a block whose extent, trigonometry and heights are set. `heights` are the posts of the block and
// its halo, (quads + 1 + 2 kHalo)^2, row-major from the south-west. Voids are omitted from the planes. Where a filtered
// level lacks a post of its differences, a plane through 3 x 3 posts replaces them. A post without enough valid
// neighbours gets the local vertical.
void fill_shading_normals(Block& block, std::span<const float> heights, const HeightsKind& kind);

}  // namespace selenograph::dem
