// The heap of all executables: jemalloc, on huge pages where the system has them. Meshes and samples are hundreds of
// megabytes that each frame reads in no order; on pages of 4 KiB a third of the frame goes by in looking up where they
// are (engine/support/README.md).
#pragma once

#include <cstddef>

namespace selenograph::engine {

struct HeapStatistics {
  std::size_t used_bytes = 0;  // what the program has asked for and not freed
  std::size_t free_bytes = 0;  // kept from the system though nothing is in it
};
// Zeros where the heap can't tell.
HeapStatistics heap_statistics();

// Gives memory that is free back to the system. Nothing else does: what a frame frees, the next one takes.
void give_back_free_memory();

// Has so much free memory ready that was written to once. The system makes a page when it is first written to, which on
// virtual machines can take seconds a gigabyte. False: there is not so much memory.
bool touch_memory(std::size_t bytes);

}  // namespace selenograph::engine
