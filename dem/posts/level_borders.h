// Divides the quadtree into chunks, determines their levels of posts, and joins heights where levels differ.
//
// Between widely spaced posts the finest surface consists of triangles; next to finer posts, the coarse layer's surface
// between its own posts is bicubic. On their common border the finer side takes the coarser side's edges. The two
// surfaces differ by metres where a global layer of 2 km adjoins a chunk of 5 m posts: a wall one fine post wide. The
// coarse layer's heights therefore change from one to the other within a quad of the coarser side.
#pragma once

#include <tbb/concurrent_unordered_map.h>

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/grid/block.h"
#include "dem/grid/lattice.h"
#include "dem/posts/post_window.h"

namespace selenograph::dem {

// A chunk starts at one of these levels and reaches at most kChunkOctaves finer: one file stays below 100 MB, and a
// frame of a small area of fine posts need not read the 4-degree tile around it.
inline constexpr std::array<int, 3> kStrata{kRootLevel, 6, 12};
// Where files have posts of different levels, chunks start at the levels between, too: what is coarse around a small
// area of fine posts is then divided into chunks of its own, as large as possible, and not down to level 12.
inline constexpr std::array<int, 8> kStrataOfLayers{kRootLevel, 6, 7, 8, 9, 10, 11, 12};
inline constexpr int kChunkOctaves = 6;
// Levels that posts beside finer ones within a node of level 6 are coarser by at most. A block's side has 64 quads: its
// corners are posts of the coarser side, even where the longitude step doubles.
inline constexpr int kMostLevelsApart = 5;

// Files of a catalogue within `margin_deg` of a block, also across a pole.
std::vector<int> files_touching(const Catalogue& catalogue, const BlockId& id, double margin_deg);
// Whether a file overlaps a block by more than a border (a single row of posts makes no surface), or is within one of
// its posts of a block that is smaller: that may lie between the outermost posts and a pole, or those of the next file.
bool any_file_within(const Catalogue& catalogue, const BlockId& id);

// Levels of a node's chunk: see ChunkPlan.
struct ChunkLevels {
  bool exists = false, direct = true;
  int base_level = 0;
};

struct ChunkNode {
  BlockId node;
  ChunkLevels levels;
};

// Part of a parallel or a meridian with the triangles of coarser posts on one side. It begins and ends at such posts.
struct LevelBorder {
  bool along_parallel = false;
  std::int64_t at = 0, from = 0, to = 0;  // ticks: its position, and its ends
  int level = 0;                          // level of the coarser posts
  std::int32_t step = 0, reach = 0;       // ticks between coarser posts, along and across the border
};

// Thread-safe.
class LevelBorders {
 public:
  explicit LevelBorders(const Catalogue& catalogue);

  // Whether there are posts of different levels.
  bool any() const { return any_; }
  // `node`: of a level at which chunks start.
  ChunkLevels levels_of(const BlockId& node) const;
  // The chunk that holds a block; where the block is finer than the posts, the one that holds its finest ancestor.
  ChunkNode chunk_of(const BlockId& id) const;
  // Level of a file (level_needed).
  int level_of_file(std::size_t file) const { return levels_[file]; }
  // Borders within `reach` of a window's posts whose coarser side is coarser than the window.
  std::vector<LevelBorder> near(const PostWindow& window) const;

 private:
  ChunkLevels found_levels(const BlockId& node) const;
  void add_borders_of(const BlockId& node, int level, std::vector<LevelBorder>& found) const;
  void add_finer_along(const LevelBorder& edge, std::int64_t outside, std::vector<LevelBorder>& found) const;

  const Catalogue& catalogue_;
  std::vector<int> levels_;  // per file
  bool any_ = false;
  std::span<const int> strata_ = kStrata;
  // Every block of every frame is looked up, by all threads at once: without a lock.
  mutable tbb::concurrent_unordered_map<BlockId, ChunkLevels, BlockIdHash> known_;
};

// Composes the heights of a row or a column of posts, without joining levels.
using ComposeLine = std::function<std::vector<float>(const PostWindow& line)>;

// Joins the heights of a window's posts with the triangles of adjacent coarser posts, using files that are no finer
// than these. NaN stays. `away_m`: each post's distance from finer layers (layer_bends.h); beside these, heights stay.
// Empty: all are far away.
void join_levels(const LevelBorders& borders, const PostWindow& window, const ComposeLine& compose,
                 std::span<const SourceMark> sources, std::span<const float> away_m, float* heights_m);

}  // namespace selenograph::dem
