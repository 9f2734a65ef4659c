// The finest surface: blocks at their finest levels, stitched as a mesh stitches them (engine/scene/mesh.h), and its
// height at a position (Terrain::height).
#pragma once

#include <memory>
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
class FinestEdges {
 public:
  // Range of the block's quads whose vertices will be used, last ones included.
  struct Quads {
    int first_row, last_row, first_column, last_column;
  };
  FinestEdges(const Terrain& terrain, const Block& block, const Quads& quads, const StopToken& stop);

  // Returns a vertex in MOON_ME, metres; NaN where there is no data.
  Vec3 vertex(int r, int c) const;
  // Returns whether any vertex may differ from the block's own.
  bool differ() const { return south_.differs() || north_.differs() || west_.differs() || east_.differs(); }

  // Return the rows and the columns (first, past the last) of the quads whose triangles may contain a position in a
  // quad: beside an edge, all quads between two remaining vertices.
  std::pair<int, int> rows(int r, int c) const;
  std::pair<int, int> columns(int r, int c) const;

 private:
  struct Edge {
    int stride = 1;                       // steps between remaining vertices
    std::shared_ptr<const Block> source;  // the neighbour that defines the heights; null: the block itself
    bool differs() const { return stride > 1 || source; }
  };

  const Block& block_;
  Edge south_, north_, west_, east_;
};

}  // namespace selenograph::dem
