// The heap of all executables: jemalloc, on huge pages where the system has them. Meshes and samples are hundreds of
// megabytes that each frame reads in no order; on pages of 4 KiB a third of the frame goes by in looking up where they
// are (engine/support/README.md).
#pragma once

#include <cstddef>

namespace selenograph::engine {

// Memory that the heap keeps from the system though nothing is in it; where it can't tell, 0.
std::size_t free_memory_bytes();

// Gives memory that is free back to the system. Nothing else does: what a frame frees, the next one takes.
void give_back_free_memory();

}  // namespace selenograph::engine
