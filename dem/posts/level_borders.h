// Divides the quadtree into chunks, determines their levels of posts, and joins heights where levels differ.
//
//  plan:   coarser chunk     border       finer chunk            section along the border:
//      o---------o---------o . . . . . . . . .                 o .
//      |       / |       / | . . . . . . . . .                  \  .         o  post of the coarser side
//      |     /   |     /   | . . . . . . . . .                    \   .      \  edge of its triangles, straight
//      | /       | /       | . . . . . . . . .                      \   .    .  bicubic surface at finer posts
//      o---------o---------o . . . . . . . . .                        \  .
//                |<-reach->|<-reach->|                                   o     gap = edge - bicubic surface
//      weight    0 ....... 1 ....... 0         height = bicubic surface + weight * gap
//
// Between widely spaced posts the finest surface consists of triangles; next to finer posts, the coarse layer's surface
// between its own posts is bicubic. On their common border the finer side takes the coarser side's edges. Without a
// transition the two surfaces would differ by metres where a global layer of 2 km adjoins a chunk of 5 m posts: a wall
// one fine post wide. The coarse layer's heights therefore change from one surface to the other within a quad of the
// coarser side. Posts of finer layers keep their heights.
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

// Levels at which chunks start if all posts are of one level. A chunk reaches at most kChunkOctaves finer: one file
// stays below 100 MB, and a frame of a small area of fine posts need not read the 4-degree tile around it.
inline constexpr std::array<int, 3> kStrata{kRootLevel, 6, 12};
// Chunks start at the levels between, too, if files have posts of different levels. The coarse ground around a small
// area of fine posts is then divided into chunks of its own. They are as large as possible, not all of level 12.
inline constexpr std::array<int, 8> kStrataOfLayers{kRootLevel, 6, 7, 8, 9, 10, 11, 12};
inline constexpr int kChunkOctaves = 6;
// Maximum difference of levels between a node's posts and its finer neighbours within the same node of level 6. A
// block's side has 64 quads: with at most five levels between, its corners are posts of the coarser side, even where
// the longitude step doubles.
inline constexpr int kMaxLevelsApart = 5;

// Returns the files of a catalogue within `margin_deg` of a block, also across a pole.
std::vector<int> files_touching(const Catalogue& catalogue, const BlockId& id, double margin_deg);
// Returns true if a file overlaps the block by more than a border: a single row of posts makes no surface. A block
// smaller than a file's post spacing also counts if the file is within one post of it. Such a block may lie between the
// file's outermost posts and a pole, or the next file.
bool any_file_within(const Catalogue& catalogue, const BlockId& id);

// Levels of a node's chunk: see ChunkPlan.
struct ChunkLevels {
  bool exists = false;  // a file covers the node
  bool direct = true;   // the chunk is made from the posts; else from the finer chunks that start at `base_level`
  int base_level = 0;   // finest level of the chunk
};

struct ChunkNode {
  BlockId node;
  ChunkLevels levels;
};

// Section of a parallel or a meridian with the triangles of coarser posts on one side. Its ends are posts of the
// coarser side.
struct LevelBorder {
  bool along_parallel = false;
  std::int64_t at = 0;    // latitude tick of the parallel, or longitude tick of the meridian
  std::int64_t from = 0;  // first and last tick along the border
  std::int64_t to = 0;
  int level = 0;   // level of the coarser posts
  Tick step = 0;   // ticks between coarser posts along the border
  Tick reach = 0;  // ticks between coarser posts across the border: half-width of the transition
};

// Levels of all chunks and the borders between them. Thread-safe.
class LevelBorders {
 public:
  explicit LevelBorders(const Catalogue& catalogue);

  // Returns true if the files have posts of different levels: else there are no borders.
  bool any() const { return any_; }
  // Returns the levels of the chunk at `node`, whose level must be one at which chunks start.
  ChunkLevels levels_of(const BlockId& node) const;
  // Returns the chunk that holds a block. If the block is finer than the posts, returns the chunk of its finest
  // ancestor with posts.
  ChunkNode chunk_of(const BlockId& id) const;
  // Returns the level of a file's posts (level_needed).
  int level_of_file(std::size_t file) const { return levels_[file]; }
  // Returns the borders within `reach` of a window's posts whose coarser side is coarser than the window.
  std::vector<LevelBorder> near(const PostWindow& window) const;

 private:
  ChunkLevels compute_levels(const BlockId& node) const;
  // near() appends to `found` by these two.
  void add_borders_of(const BlockId& node, int level, std::vector<LevelBorder>& found) const;
  void add_finer_along(const LevelBorder& edge, std::int64_t outside, std::vector<LevelBorder>& found) const;

  const Catalogue& catalogue_;
  std::vector<int> levels_;  // per file
  bool any_ = false;
  std::span<const int> strata_ = kStrata;  // levels at which chunks start
  // All threads look up every block of every frame at once: the cache has no lock.
  mutable tbb::concurrent_unordered_map<BlockId, ChunkLevels, BlockIdHash> levels_cache_;
};

// Composes the heights of a row or a column of posts, m, without joining levels. Called by join_levels() for a border's
// edge.
using ComposeLine = std::function<std::vector<float>(const PostWindow& line)>;

// Moves the heights of a window's posts towards the triangles of adjacent coarser posts. Only posts from files no finer
// than these triangles move; NaN stays. `finer_distance_m`: each post's distance from finer layers (layer_bends.h);
// near 0 heights stay. An empty `finer_distance_m` means that no finer layer is near.
void join_levels(const LevelBorders& borders, const PostWindow& window, const ComposeLine& compose,
                 std::span<const SourceMark> sources, std::span<const float> finer_distance_m, float* heights_m);

}  // namespace selenograph::dem
