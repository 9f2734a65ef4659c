// Smooth shading normals from posts.
//
// Integer metres quantise slopes: 1 m in 7.4 m is 7.7 degrees, and normals from raw neighbour differences show
// terraces. The slope at a post is therefore the least-squares plane through the posts around it (Savitzky & Golay
// 1964): 3 x 3, or 5 x 5 where quantisation would still leave more than kQuantisationSlope of noise (standard
// deviation) in the small one. Positions stay on the posts as they are: only shading is smoothed.
#pragma once

#include <span>

#include "dem/block.h"

namespace selenograph::dem {

inline constexpr int kHalo = 2;                     // posts beyond the block on each side that the stencil may need
inline constexpr double kQuantisationSlope = 0.01;  // 0.6 degrees

// `heights` are (quads + 1 + 2 kHalo)^2 posts, row-major from the south-west, around the block whose extent,
// trigonometry and heights are already filled. NaN posts are left out; a post without enough valid neighbours gets the
// local vertical.
void fill_shading_normals(Block& block, std::span<const float> heights, double quantisation_m);

}  // namespace selenograph::dem
