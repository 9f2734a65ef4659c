// The heap of all executables: jemalloc, on huge pages if the system has them. Meshes and samples are hundreds of
// megabytes that each frame reads in random order; with pages of 4 KiB a third of the frame time is spent on address
// translation (engine/support/README.md).
#pragma once

#include <cstddef>

namespace selenograph::engine {

struct HeapStatistics {
  std::size_t used_bytes = 0;  // allocated by the program
  std::size_t free_bytes = 0;  // free, but not returned to the system
};
// Zeros if the heap does not report them.
HeapStatistics heap_statistics();

// Returns free memory to the system. Nothing else does: the next frame reuses what a frame frees.
void give_back_free_memory();

// Touches so much free memory. The system allocates a page on its first write, which on virtual machines can take
// seconds per gigabyte. Returns false if there is not so much memory.
bool touch_memory(std::size_t bytes);

}  // namespace selenograph::engine
