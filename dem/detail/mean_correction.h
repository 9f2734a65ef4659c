// The mean of the detail over each post's cell, which is subtracted from the detail at the post: so means over cells
// are those of the DEM.
//
//   detail h(x) --average over each post's cell--> means --sharpened()--> heights at posts --bicubic--> c(x)
//
// The ground gets h(x) - c(x), whose mean over every cell is 0.
//
// Cubic interpolation flattens cell means. They are sharpened first, so that the interpolated surface has them again.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/crater_field.h"
#include "dem/detail/detail.h"
#include "dem/grid/block.h"

namespace selenograph::dem {

// Half width, in cells, of the sharpening filter.
inline constexpr int kCellsAround = 4;
// Returns heights of posts whose bicubic interpolation has the given means over the posts' cells. `means` is a square
// of `side` rows. Results within kCellsAround of its border are not valid.
std::vector<double> sharpened(const std::vector<double>& means, std::size_t side);

// Returns the weight of the correction on a row of posts, 0 to 1. It is 0 beside a pole, where cells are slivers: their
// means would form rays that meet in the pole.
double correction_weight(Tick lat, Tick lat_step);

// 16 x 16 quads of a block of posts, the unit in which mean corrections are made: a lander sees few posts, and a whole
// block would correct many that it never uses.
//
//   +----+----+----+----+
//   |3,0 |    |    |3,3 |     block of 64 x 64 quads, sub-blocks by (north, east)
//   +----+----+----+----+
//   |    |    |    |    |     posts on a common edge belong to both sub-blocks;
//   +----+----+----+----+     SubBlock::of chooses the northern and eastern one
//   |0,0 |0,1 |    |0,3 |
//   +----+----+----+----+
struct SubBlock {
  BlockId block;
  int north = 0, east = 0;  // index from the south and from the west

  static constexpr int kMaxPerSide = 4;
  // Returns the sub-block of the post in row `r` and column `c` of the block.
  static SubBlock of(const BlockId& block, int r, int c) {
    const SubBlock first{block};
    return {block, std::min(r / first.quads(), first.per_side() - 1),
            std::min(c / first.quads(), first.per_side() - 1)};
  }
  int per_side() const { return std::min(kMaxPerSide, quads_per_side(block.level)); }
  int quads() const { return quads_per_side(block.level) / per_side(); }
  BlockExtent extent() const {
    const BlockExtent e = extent_of(block);
    return {e.lat0 + north * quads() * e.lat_step, e.lon0 + east * quads() * e.lon_step, e.lat_step, e.lon_step,
            quads()};
  }
  BlockId key() const { return {block.level, kMaxPerSide * block.row + north, kMaxPerSide * block.col + east}; }
};
// Returns factors of the relief's amplitudes (Detail::add) at latitudes and longitudes in ticks, row by row.
using ReliefFactors = std::function<std::vector<double>(std::span<const std::int64_t>, std::span<const std::int64_t>)>;
// Makes the heights to subtract at a sub-block's posts: the means of the detail that they do not resolve over their
// cells. `relief_factors` is not called unless the relief follows the posts.
std::shared_ptr<const Block> make_mean_correction(const Detail& detail, const SubBlock& sub_block,
                                                  const ReliefFactors& relief_factors, const StopToken& stop);

// Returns the share of a crater's depth that the correction leaves, with posts of the given level. Depth is the mean
// height on the rim circle minus the height at the centre, of this crater alone.
double depth_left(const Crater& crater, int posts_level);

}  // namespace selenograph::dem
