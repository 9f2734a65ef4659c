// The heap of all executables: jemalloc, on huge pages if the system has them. Meshes and samples are hundreds of
// megabytes that each frame reads in random order. With pages of 4 KiB, address translation takes a third of the frame
// time (engine/support/README.md).
#pragma once

#include <cstddef>

namespace selenograph::engine {

struct HeapStatistics {
  std::size_t used_bytes = 0;  // allocated by the program
  std::size_t free_bytes = 0;  // free, but not returned to the system
};
// Returns the heap's statistics; zeros if the heap does not report them.
HeapStatistics heap_statistics();

}  // namespace selenograph::engine
