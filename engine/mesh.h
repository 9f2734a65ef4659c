// Selected blocks joined to one continuous mesh without holes.
//
// Where blocks meet, every vertex on the common edge is the same one, bit for bit: the finer side gives up the vertices
// that the coarser one lacks (they collapse onto the next one that it has), and heights on an edge are those of one of
// the blocks, chosen the same way from either side: the coarsest, then the smallest id, among those with data there.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "dem/block.h"
#include "dem/surface.h"
#include "dem/terrain.h"

namespace selenograph::engine {

struct MeshBlock {
  std::shared_ptr<const dem::Block> posts;
  // (quads + 1)^2, row-major from the south-west: MOON_ME, metres, double, as joined; NaN where there is no data. A
  // vertex that has collapsed holds the place of the one that it has collapsed onto.
  std::vector<Vec3> vertices;
  std::array<int, 4> stride{1, 1, 1, 1};  // south, north, west, east: every stride-th vertex of the edge remains

  const Vec3& vertex(int r, int c) const { return vertices[posts->index(r, c)]; }
  // For shading; a vertex that has collapsed has the normal of the one that it has collapsed onto.
  const Eigen::Vector3f& normal(int r, int c) const {
    const int quads = posts->extent.quads;
    if (r == 0) c -= c % stride[0];
    if (r == quads) c -= c % stride[1];
    if (c == 0) r -= r % stride[2];
    if (c == quads) r -= r % stride[3];
    return posts->normals[posts->index(r, c)];
  }
};

// A triangle of the mesh: block, quad (south-west vertex) and which half (dem/surface.h).
struct TriangleId {
  std::uint32_t block = 0;
  std::uint16_t r = 0, c = 0;
  bool upper = false;
};

class Mesh {
 public:
  // `blocks` sorted; those without a single valid post are left out. Loads in parallel; throws what the terrain throws.
  Mesh(const dem::Terrain& terrain, const std::vector<dem::BlockId>& blocks);

  const std::vector<MeshBlock>& blocks() const { return blocks_; }
  dem::Triangle triangle(const TriangleId& id) const {
    const dem::QuadVertices q = dem::vertices_of(id.r, id.c, id.upper);
    const MeshBlock& b = blocks_[id.block];
    return {b.vertex(q.r[0], q.c[0]), b.vertex(q.r[1], q.c[1]), b.vertex(q.r[2], q.c[2])};
  }

  // Index of the block that holds a place (ticks of the lattice).
  std::optional<std::uint32_t> block_at(std::int64_t lat_tick, std::int64_t lon_tick,
                                        int finest_level = dem::kMaxLevel) const;

  std::size_t bytes() const;

 private:
  void join(MeshBlock& block) const;
  void join_edge(MeshBlock& block, int edge) const;
  float joined_height(const dem::BlockId& own, std::int64_t lat, std::int64_t lon) const;

  std::vector<MeshBlock> blocks_;
  std::unordered_map<dem::BlockId, std::uint32_t, dem::BlockIdHash> index_;
  int coarsest_ = 0, finest_ = 0;
};

}  // namespace selenograph::engine
