// The mean of the detail over each post's cell, which is subtracted from the detail at the post: so means over cells
// are those of the DEM.
//
//   detail h(x) --average over each post's cell--> means --sharpened()--> heights at posts --bicubic--> c(x)
//
// The ground gets h(x) - c(x), whose mean over every cell is 0.
//
// Cubic interpolation flattens cell means. They are sharpened first, so that the interpolated surface has them again.
#pragma once

#include <cstdint>
#include <vector>

#include "dem/detail/crater_field.h"

namespace selenograph::dem {

// Half width, in cells, of the sharpening filter.
inline constexpr int kCellsAround = 4;
// Returns heights of posts whose bicubic interpolation has the given means over the posts' cells. `means` is a square
// of `side` rows. Results within kCellsAround of its border are not valid.
std::vector<double> sharpened(const std::vector<double>& means, std::size_t side);

// Returns the weight of the correction on a row of posts, 0 to 1. It is 0 beside a pole, where cells are slivers: their
// means would form rays that meet in the pole.
double correction_weight(std::int32_t lat, std::int32_t lat_step);

// Returns the share of a crater's depth that the correction leaves, with posts of the given level. Depth is the mean
// height on the rim circle minus the height at the centre, of this crater alone.
double depth_left(const Crater& crater, int posts_level);

}  // namespace selenograph::dem
