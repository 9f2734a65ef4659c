// The mean of the detail over each post's cell, which is subtracted from it at the post, so that means over cells are
// the DEM's.
#pragma once

#include <cstdint>
#include <vector>

#include "dem/detail/crater_field.h"

namespace selenograph::dem {

// Cells of which each is a little of what is taken in a post's.
inline constexpr int kCellsAround = 4;
// Posts between which bicubic interpolation has given means over their cells, of a square of so many, row by row; those
// within kCellsAround of its border are none.
std::vector<double> sharpened(const std::vector<double>& means, std::size_t side);

// Beside a pole cells are slivers, whose means would be rays that meet in it: the posts there keep their heights.
double share_of_means(std::int32_t lat, std::int32_t lat_step);

// Share of a crater's depth that posts of a level leave to it: the mean on the circle of its diameter less the height
// of its middle, of the crater alone.
double depth_left(const Crater& crater, int posts_level);

}  // namespace selenograph::dem
