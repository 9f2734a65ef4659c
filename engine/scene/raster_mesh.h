// The mesh for rasterisation: float relative to an anchor, structure of arrays, in strips with tight bounds.
//
//   block: 64 x 64 quads       +--------------+  strip 3      Strips of 16 rows have boxes along the block's axes.
//   RasterShape: no anchor     +--------------+  strip 2
//   RasterPiece: with anchor   +--------------+  strip 1      A skirt hangs below each edge that no second
//                              +--------------+  strip 0      triangle shares.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/scene/mesh.h"

namespace selenograph::engine {

inline constexpr std::uint32_t kNoTriangle = 0xffffffff;  // stands for TriangleId::packed() of no triangle

// Vertices of one block, rows from the south, `stride` floats apart; entries beyond the last column are NaN.
struct RasterBlock {
  const float *x = nullptr, *y = nullptr, *z = nullptr;  // relative to the anchor, metres
  int quads = 0, stride = 0;
  const dem::Vertex* vertices = nullptr;
};

// Several rows of quads of a block, with a bounding box along the block's own axes (east, north, up at its middle).
struct Strip {
  std::uint32_t block;
  int first_row, rows;
  float centre[3];    // centre of the box, relative to the anchor
  float half[3][3];   // half edges of the box: east, north, up
  float steepest[8];  // as in LocalBounds
};

// A triangle of the skirts at data boundaries, which extend below all relief. With skirts, every ray that enters the
// ground passes the front face of a triangle, as shadows require.
struct Skirt {
  float a[3], b[3], c[3];  // counter-clockwise from outside, relative to the anchor
};

// Raster data of one block that does not depend on the anchor. Immutable, shared like the block.
struct RasterShape {
  explicit RasterShape(std::shared_ptr<const MeshBlock> block);

  // Box of a strip, MOON_ME, m.
  struct Box {
    int first_row, rows;
    Vec3 centre;
    EastNorthUp axes;
    Vec3 half_m;                    // half edges along the axes
    std::array<float, 8> steepest;  // steepest rises of the triangles, as in LocalBounds
  };
  // An edge as indices of vertices in RasterBlock; its triangle is on the left.
  struct Edge {
    std::uint16_t from, to;
  };

  std::shared_ptr<const MeshBlock> mesh_block;
  int stride;  // as in RasterBlock
  std::vector<Box> boxes;
  // Edges that only one triangle of the block has: `inside` beside no-data, `along` on the two halves (from west or
  // south) of each side.
  std::vector<Edge> inside;
  struct Half {
    std::vector<Edge> edges;
    std::uint64_t edge_hash = 0;  // equal for opposite directions; 0: no edges
  };
  std::array<std::array<Half, 2>, 4> along;

  Vec3 vertex(std::uint16_t index) const { return mesh_block->vertex(index / stride, index % stride); }
  std::size_t bytes() const;
};

// Drawable data of one block at an anchor. Immutable, shared like the block.
struct RasterPiece {
  RasterPiece(std::shared_ptr<const RasterShape> shape_of_block, const Vec3& anchor_m);

  std::shared_ptr<const RasterShape> shape;
  std::vector<float> xyz;  // all x, then all y, then all z
  RasterBlock block;
  std::vector<Strip> strips;  // their block index is 0 until the mesh sets it
  std::size_t bytes() const;
};

// Data of a mesh that another mesh may reuse: shapes and, for the same anchor, pieces.
struct RasterParts {
  std::vector<std::shared_ptr<const RasterShape>> shapes;
  std::vector<std::shared_ptr<const RasterPiece>> pieces;  // as many as shapes, or none
};

class RasterMesh {
 public:
  // `before`: data of a mesh that may have blocks in common. Throws Cancelled once `stop` is requested.
  RasterMesh(const Mesh& mesh, const Vec3& anchor_m, const RasterParts& before = {}, const StopToken& stop = {});

  // Returns the data that a mesh with this anchor may reuse.
  RasterParts parts_for(const Vec3& anchor_m) const;

  const Vec3& anchor() const { return anchor_; }
  const std::vector<RasterBlock>& blocks() const { return blocks_; }
  const std::vector<Strip>& strips() const { return strips_; }
  const std::vector<Skirt>& skirts() const { return skirts_; }
  const std::vector<std::shared_ptr<const RasterPiece>>& pieces() const { return pieces_; }
  std::size_t bytes() const;      // including shared pieces
  std::size_t own_bytes() const;  // without shared pieces

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
