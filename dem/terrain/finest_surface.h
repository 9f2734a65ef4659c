// The finest surface: a block at its finest beside others at theirs, as a mesh joins them (engine/scene/mesh.h); and
// its height at a place (Terrain::height).
#pragma once

#include <memory>
#include <utility>

#include "dem/terrain/terrain.h"

namespace selenograph::dem {

// Of the vertices on an edge with a coarser block those are left which that one has, too; the others collapse onto the
// ones before them. Their heights are the neighbour's where its posts are coarser, or are as far apart but in longitude
// and it is the southern one.
class FinestEdges {
 public:
  // Quads of the block whose vertices are asked for; the last ones are included.
  struct Quads {
    int first_row, last_row, first_column, last_column;
  };
  FinestEdges(const Terrain& terrain, const Block& block, const Quads& quads, const StopToken& stop);

  // MOON_ME, metres; NaN where there is no data.
  Vec3 vertex(int r, int c) const;
  // Whether some vertices may be others than the block's own.
  bool differ() const { return south_.differs() || north_.differs() || west_.differs() || east_.differs(); }

  // Of the quads whose triangles may have a place in one of them: those that share what is left of an edge.
  std::pair<int, int> rows(int r, int c) const;
  std::pair<int, int> columns(int r, int c) const;

 private:
  struct Edge {
    int stride = 1;
    std::shared_ptr<const Block> holds;  // whose heights hold; null: own
    bool differs() const { return stride > 1 || holds; }
  };

  const Block& block_;
  Edge south_, north_, west_, east_;
};

}  // namespace selenograph::dem
