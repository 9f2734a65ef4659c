// What a chunk of the pyramid is made of.
#pragma once

#include <cstdint>

#include "dem/grid/lattice.h"

namespace selenograph::dem {

// Direct: its base level comes from the sources. Otherwise its base level is the top level of
// the finer chunks beneath, which hold that level themselves.
struct ChunkPlan {
  BlockId node;
  int base_level = 0;
  bool direct = true;
  std::uint64_t fingerprint = 0;  // of everything that the content depends on
  bool exists = false;            // some source touches it
  bool on_network = false;        // one of the files that it is made of is on a network
  int coarsest_level() const { return node.level == kRootLevel ? 0 : node.level; }
  int finest_level() const { return direct ? base_level : base_level - 1; }
};

}  // namespace selenograph::dem
