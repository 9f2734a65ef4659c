// The mesh as rasterisers want it: float relative to an anchor, structure of arrays, in strips with tight bounds.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "dem/support/stop_token.h"
#include "engine/scene/mesh.h"

namespace selenograph::engine {

inline constexpr std::uint32_t kNoTriangle = 0xffffffff;  // instead of TriangleId::packed()

// Vertices of one block, rows from the south, `stride` floats apart; what lies beyond the last column is NaN.
struct RasterBlock {
  const float *x = nullptr, *y = nullptr, *z = nullptr;  // relative to the anchor, metres
  int quads = 0, stride = 0;
  const dem::Vertex* vertices = nullptr;
};

// Some rows of quads of a block, in a box along the block's own axes (east, north, up at its middle).
struct Strip {
  std::uint32_t block;
  int first_row, rows;
  float centre[3];    // of the box, relative to the anchor
  float half[3][3];   // half its edges: east, north, up
  float steepest[8];  // as in LocalBounds
};

// A triangle of the skirts at data boundaries, which reach down to below all relief: with them every ray that goes into
// the ground does so through a triangle that it meets from outside. Shadows rely on that.
struct Skirt {
  float a[3], b[3], c[3];  // counter-clockwise from outside, relative to the anchor
};

// What doesn't depend on the anchor of one block of a mesh; immutable, shared like it.
struct RasterShape {
  explicit RasterShape(std::shared_ptr<const MeshBlock> block);

  // A strip's box, MOON_ME, metres.
  struct Box {
    int first_row, rows;
    Vec3 centre;
    EastNorthUp axes;
    Vec3 half_m;                    // half its edges along them
    std::array<float, 8> steepest;  // of its triangles, as in LocalBounds
  };
  // Index of a vertex in RasterBlock; the triangle is on the left.
  struct Edge {
    std::uint16_t from, to;
  };

  std::shared_ptr<const MeshBlock> of;
  int stride;  // of RasterBlock
  std::vector<Box> boxes;
  // Edges of triangles that no other triangle of the block shares: beside voids, and along the two halves (from west or
  // south) of each side of the block.
  std::vector<Edge> inside;
  struct Half {
    std::vector<Edge> edges;
    std::uint64_t mark = 0;  // a sum over its edges, the same for whatever runs along it the other way; 0: none
  };
  std::array<std::array<Half, 2>, 4> along;

  Vec3 vertex(std::uint16_t index) const { return of->vertex(index / stride, index % stride); }
  std::size_t bytes() const;
};

// What is drawn of one block of a mesh; immutable, shared like it.
struct RasterPiece {
  RasterPiece(std::shared_ptr<const RasterShape> shape_of_block, const Vec3& anchor_m);

  std::shared_ptr<const RasterShape> shape;
  std::vector<float> xyz;  // x, y, z one after the other
  RasterBlock block;
  std::vector<Strip> strips;  // of block 0
  std::size_t bytes() const;
};

// What another mesh may take over of one: shapes, and for the same anchor the pieces made of them.
struct RasterParts {
  std::vector<std::shared_ptr<const RasterShape>> shapes;
  std::vector<std::shared_ptr<const RasterPiece>> pieces;  // as many, or none
};

class RasterMesh {
 public:
  // `before`: of a mesh that may have blocks in common, for the same anchor. Throws Cancelled when `stop` says so.
  RasterMesh(const Mesh& mesh, const Vec3& anchor_m, const RasterParts& before = {}, const StopToken& stop = {});

  RasterParts parts_for(const Vec3& anchor_m) const;

  const Vec3& anchor() const { return anchor_; }
  const std::vector<RasterBlock>& blocks() const { return blocks_; }
  const std::vector<Strip>& strips() const { return strips_; }
  const std::vector<Skirt>& skirts() const { return skirts_; }
  const std::vector<std::shared_ptr<const RasterPiece>>& pieces() const { return pieces_; }
  std::size_t bytes() const;      // of all
  std::size_t own_bytes() const;  // without the pieces

 private:
  void add_skirts();
  void add_skirt(const Vec3& from, const Vec3& to);

  Vec3 anchor_;
  std::vector<std::shared_ptr<const RasterPiece>> pieces_;  // per block
  std::vector<RasterBlock> blocks_;
  std::vector<Strip> strips_;
  std::vector<Skirt> skirts_;
};

}  // namespace selenograph::engine
