// The finest surface: blocks at their finest levels, stitched as a mesh stitches them (engine/scene/mesh.h), and its
// height at a position (Terrain::height).
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <utility>

#include "dem/terrain/terrain.h"

namespace selenograph::dem {

// A block's vertices on the finest surface. On an edge with a coarser block only its vertices remain; each other vertex
// collapses onto the remaining one before it:
//
//   coarser neighbour   o-----------o-----------o
//                       0     1     2     3     4     stride 2: vertices 1 and 3 of the edge collapse onto 0 and 2
//   this block          o-----x-----o-----x-----o
//
// A vertex has the neighbour's height if the neighbour's posts are coarser. It also has it if the posts are as dense
// along the meridian, differ in their spacing in longitude, and the neighbour's id is smaller (it lies south).
//
// An edge's neighbour is found when a vertex on it is first asked for: finding it may make a block. Not thread-safe.
class FinestEdges {
 public:
  FinestEdges(const Terrain& terrain, const Block& block, const StopToken& stop)
      : terrain_(terrain), block_(block), stop_(stop) {}

  // Returns a vertex in MOON_ME, metres; NaN where there is no data.
  Vec3 vertex(int r, int c);
  // Returns whether any vertex may differ from the block's own.
  bool differ();

  // Return the rows and the columns (first, past the last) of the quads whose triangles may contain a position in a
  // quad: beside an edge, all quads between two remaining vertices.
  std::pair<int, int> rows(int r, int c);
  std::pair<int, int> columns(int r, int c);

 private:
  enum class Side { south, north, west, east };
  struct Edge {
    int stride = 1;                       // steps between remaining vertices
    std::shared_ptr<const Block> source;  // the neighbour that defines the heights; null: the block itself
    bool differs() const { return stride > 1 || source; }
  };
  const Edge& edge(Side side);
  Edge find_edge(Side side);

  const Terrain& terrain_;
  const Block& block_;
  const StopToken& stop_;
  std::optional<int> posts_level_;  // of the block
  std::array<std::optional<Edge>, 4> edges_;
};

}  // namespace selenograph::dem
