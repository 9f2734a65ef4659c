// Windows of the lattice, and their posts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "dem/base/uninitialised.h"
#include "dem/grid/block.h"
#include "dem/posts/source_rows.h"

namespace selenograph::dem {

// Window of posts: rows of latitude ticks lat0 + r * lat_step, columns of longitude ticks lon0 + c * lon_step. It may
// reach past a pole (rows continue on the opposite meridian) and around the globe.
struct PostWindow {
  std::int64_t lat0 = 0, lon0 = 0;
  std::int32_t lat_step = 1, lon_step = 1;
  int rows = 0, cols = 0;
  std::size_t size() const { return static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols); }
};

// Heights and sources of a window's posts, row by row.
struct Posts {
  std::vector<float> heights;           // m, NaN: no data
  std::vector<SourceMark> sources;      // as in Block::sources
  std::vector<SourceIndex> replaced{};  // unusable files that the next coarser layer replaced; ascending
};

// Grid of posts that is too large for a mark per post.
struct PostGridRows {
  UninitialisedVector<float> heights;  // as in Posts
  SourceRows sources;
  std::vector<SourceIndex> replaced{};
};

// Longest distance, in posts, of the valid posts on two opposite sides between which no-data is interpolated. At
// SLDEM2013's 4096 px/deg it is 240 m, which closes gaps of stereo matching in small shadows and leaves real gaps open.
inline constexpr int kFillReach = 32;

}  // namespace selenograph::dem
