// Plan of a pyramid chunk: the levels and sources that it is made from.
#pragma once

#include <cstdint>

#include "dem/grid/lattice.h"

namespace selenograph::dem {

// Levels and sources of a chunk. A direct chunk's base level comes from the sources. Otherwise its base level is the
// top level of the finer chunks below, which contain that level or posts that are farther apart.
struct ChunkPlan {
  BlockId node;
  int base_level = 0;
  bool direct = true;
  std::uint64_t fingerprint = 0;  // hash of everything that the content depends on
  bool exists = false;            // a source touches the node
  int coarsest_level() const { return node.level == kRootLevel ? 0 : node.level; }
  int finest_level() const { return direct ? base_level : base_level - 1; }
};

}  // namespace selenograph::dem
