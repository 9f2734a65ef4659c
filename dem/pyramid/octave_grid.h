// Posts of a chunk, level by level: the finest, and each coarser one filtered from it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "dem/posts/post_source.h"
#include "dem/pyramid/chunk.h"

namespace selenograph::dem {

// Posts of one level over the chunk and a halo around it.
struct OctaveGrid {
  int level = 0;
  int halo = 0;  // posts around the chunk on each side
  PostWindow window;
  PostGridRows posts;
  // Returns the height at a row and column; outside the window, that of its outermost post.
  float at(int r, int c) const {
    r = std::clamp(r, 0, window.rows - 1);
    c = std::clamp(c, 0, window.cols - 1);
    return posts.heights[index(r, c)];
  }
  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(window.cols) + static_cast<std::size_t>(c);
  }
  const float* row(int r) const { return posts.heights.data() + index(std::clamp(r, 0, window.rows - 1), 0); }
};

// Returns the lattice posts of a node at a level, with `halo` more on each side.
PostWindow window_of(const BlockId& node, int level, int halo);
// Returns the halo of a chunk's finest level: each octave uses one post, and kHalo remain at the coarsest.
int base_halo(const ChunkPlan& plan);

// Deviation of the finer chunks' top blocks from the finest surface: largest distance, and how far the surface extends
// below and above them.
struct LeftOut {
  double error_m = 0;
  float below_m = 0, above_m = 0;
  void add(const Block& block);
};

// Makes a chunk's finest posts: from the files, or from the top blocks of finer chunks.
OctaveGrid direct_base(const ChunkPlan& plan, const PostSource& source, Chunk::Scratch& scratch, const StopToken& stop);
OctaveGrid base_from_finer(const ChunkPlan& plan, const Chunk::Finer& finer, LeftOut& left_out, Chunk::Scratch& scratch,
                           const StopToken& stop);
// Makes the next coarser level: a 3 x 3 binomial filter, rounded to the level's step.
OctaveGrid coarser(const BlockId& node, const OctaveGrid& fine, Chunk::Scratch& scratch, const StopToken& stop);

// Position of a block's posts in its level's grid.
struct BlockCut {
  BlockId id;
  int r0, c0, stride_c;  // grid position of the south-west vertex; grid columns per block column
};

BlockCut cut_of(const OctaveGrid& grid, const BlockId& id);
// Returns the blocks of a node at a level.
std::vector<BlockId> blocks_of(const BlockId& node, int level);

}  // namespace selenograph::dem
