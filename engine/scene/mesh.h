// Stitches the selected blocks to one continuous mesh without holes.
//
//   coarse  o-----------o-----------o
//           |  \     /  |  \     /  |
//   fine    o-----x     o-----x     o     x collapses onto the next remaining vertex to the west or south
//
// Blocks share every vertex on a common edge, bit for bit. The finer side drops the vertices that the coarser side
// lacks: they collapse. Heights on an edge are those of one of the adjacent blocks, chosen the same way from either
// side: the coarsest, then the one of the coarsest posts, then the smallest id, among those with data there.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "dem/grid/block.h"
#include "dem/grid/surface.h"
#include "dem/terrain/terrain.h"
#include "engine/scene/soft_normals.h"
#include "engine/support/triangle_id.h"

namespace selenograph::engine {

// A block's stitched border: edge 0 south, 1 north, 2 west, 3 east, from west or south.
struct BlockBorder {
  std::array<int, 4> stride{1, 1, 1, 1};  // every stride-th vertex of the edge remains
  std::array<std::vector<float>, 4>
      height;        // heights of the remaining vertices, m; a collapsed one repeats that before it
  Corners soft = 0;  // shares of smoothed normals at the corners
  bool operator==(const BlockBorder& border) const;  // compares heights bit for bit
};

// Immutable; shared between the meshes of frames that have the block and its surroundings in common.
struct MeshBlock {
  // Sine and cosine of a row's latitude or a column's longitude.
  struct alignas(16) Turn {
    double sin, cos;
  };

  MeshBlock(std::shared_ptr<const dem::Block> block, BlockBorder joined);
  MeshBlock(const MeshBlock&) = delete;
  MeshBlock& operator=(const MeshBlock&) = delete;

  std::shared_ptr<const dem::Block> posts;
  BlockBorder border;
  int side;  // quads + 1
  int axis;  // axis of MOON_ME nearest to the vertical of the block's middle
  // (quads + 1)^2 stitched vertices, row by row from the south-west. A collapsed vertex has height and normal of the
  // one that it collapses onto. If the border is unchanged and no corner soft, these are the posts' own vertices.
  std::span<const dem::Vertex> vertices;
  std::vector<Turn> rows, columns;
  std::span<const std::uint16_t> brightness;  // Block::brightness of the posts; a collapsed vertex keeps its own
  bool collapses;                             // some vertices of the border have collapsed

  // The mark of all posts if they have one source and are all filled or all not. Otherwise the mark of the middle post,
  // and `mixed` tells which quads have others, one bit per column.
  dem::SourceMark source;
  std::vector<std::uint64_t> mixed;  // per row of quads; empty without mixed quads

  // Returns row and column of the remaining vertex that this one collapses onto.
  std::array<int, 2> remaining(int r, int c) const {
    const int quads = posts->extent.quads;
    const std::array<int, 4>& stride = border.stride;
    if (r == 0) c -= c % stride[0];
    if (r == quads) c -= c % stride[1];
    if (c == 0) r -= r % stride[2];
    if (c == quads) r -= r % stride[3];
    return {r, c};
  }
  // Returns true if a quad touches the block's border.
  bool on_border(int r, int c) const {
    const int last = posts->extent.quads - 1;
    return r == 0 || c == 0 || r == last || c == last;
  }

  // Returns a vertex, MOON_ME, m; NaN without data.
  Vec3 vertex(int r, int c) const {
    const auto [row, column] = remaining(r, c);
    return posts->position(row, column, static_cast<double>(vertices[posts->index(r, c)].height_m));
  }
  bool present(int r, int c) const { return !std::isnan(vertices[posts->index(r, c)].height_m); }
  const Vec3f& normal(int r, int c) const { return vertices[posts->index(r, c)].normal; }
  std::size_t bytes() const;  // without the posts, which the terrain's cache counts

 private:
  bool border_is_unchanged() const;

  std::vector<dem::Vertex> own_;  // storage of `vertices`, if they are not the posts'
};

// Shared blocks as a random-access range. (Clang 14 cannot compile std::views of GCC 12's library.)
class MeshBlocks {
 public:
  using Shared = std::vector<std::shared_ptr<const MeshBlock>>;
  explicit MeshBlocks(const Shared& blocks) : blocks_(&blocks) {}

  class Iterator {
   public:
    explicit Iterator(Shared::const_iterator at) : at_(at) {}
    const MeshBlock& operator*() const { return **at_; }
    Iterator& operator++() {
      ++at_;
      return *this;
    }
    bool operator==(const Iterator&) const = default;

   private:
    Shared::const_iterator at_;
  };
  Iterator begin() const { return Iterator(blocks_->begin()); }
  Iterator end() const { return Iterator(blocks_->end()); }
  std::size_t size() const { return blocks_->size(); }
  bool empty() const { return blocks_->empty(); }
  const MeshBlock& front() const { return *blocks_->front(); }
  const MeshBlock& back() const { return *blocks_->back(); }
  const MeshBlock& operator[](std::size_t i) const { return *(*blocks_)[i]; }

 private:
  const Shared* blocks_;
};

// Returns blocks in the order of their ids; null without data, as from Terrain::block(). Loads in parallel, from a
// network on separate threads. `before`: may be null.
class Mesh;
std::vector<std::shared_ptr<const dem::Block>> load_blocks(const dem::Terrain& terrain,
                                                           const std::vector<dem::BlockId>& ids, const Mesh* before,
                                                           const StopToken& stop);

class Mesh {
 public:
  // `blocks`: sorted, at most TriangleId::kMaxBlocks; those without a valid post are left out. Loads in parallel;
  // throws what the terrain throws. `before`: a mesh whose unchanged blocks are reused; may be null. `soft`: shares of
  // smoothed normals at each block's corners; empty: none.
  Mesh(const dem::Terrain& terrain, const std::vector<dem::BlockId>& blocks, const Mesh* before = nullptr,
       const StopToken& stop = {}, const std::vector<Corners>& soft = {});

  MeshBlocks blocks() const { return MeshBlocks(blocks_); }
  std::shared_ptr<const MeshBlock> share(std::size_t block) const { return blocks_[block]; }
  // Returns a block; null if the mesh does not contain it.
  std::shared_ptr<const MeshBlock> share(const dem::BlockId& id) const;
  dem::Triangle triangle(const TriangleId& id) const {
    const dem::QuadVertices q = id.vertices();
    const MeshBlock& b = *blocks_[id.block()];
    return {b.vertex(q.r[0], q.c[0]), b.vertex(q.r[1], q.c[1]), b.vertex(q.r[2], q.c[2])};
  }

  // Returns the index of the block that contains a position, in lattice ticks.
  std::optional<std::uint32_t> block_at(std::int64_t lat_tick, std::int64_t lon_tick,
                                        int finest_level = dem::kMaxLevel) const;
  // Returns the index of the block above or below a position.
  std::optional<std::uint32_t> block_at(const Vec3& position_m) const;

  // Returns whether made ground of the mesh is brighter or darker in places.
  bool varies_in_brightness() const { return varies_in_brightness_; }

  bool holds(const dem::BlockId& id) const { return index_.count(id) > 0; }

  std::size_t bytes() const;

 private:
  std::vector<dem::BlockExtent> changes_since(const Mesh& before) const;
  BlockBorder border_of(const dem::Block& block) const;
  void stitch_edge(const dem::Block& block, int edge, BlockBorder& out) const;
  bool is_before(std::uint32_t block, std::uint32_t neighbour) const;
  float corner_height(const dem::BlockId& own, std::int64_t lat, std::int64_t lon) const;

  std::vector<std::shared_ptr<const dem::Block>> posts_;  // posts of blocks_
  std::vector<int> posts_levels_;                         // level of the plain terrain's posts, per block
  std::vector<std::shared_ptr<const MeshBlock>> blocks_;
  std::unordered_map<dem::BlockId, std::uint32_t, dem::BlockIdHash> index_;
  int coarsest_ = 0, finest_ = 0;
  bool varies_in_brightness_ = false;
};

}  // namespace selenograph::engine
