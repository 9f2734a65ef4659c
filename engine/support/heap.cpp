#include "engine/support/heap.h"

// The sanitizers have allocators of their own.
#ifdef SELENOGRAPH_JEMALLOC

#include <jemalloc/jemalloc.h>

#include <algorithm>
#include <cstdint>
#include <string>

// Read by jemalloc as the process starts. Huge pages for everything; free pages are kept until give_back_free_memory();
// large arrays are no exception to that; few arenas, since each keeps its own free memory and large arrays, which are
// what counts here, are not taken often enough to wait for each other.
extern "C" const char* malloc_conf;
const char* malloc_conf =
    "thp:always,metadata_thp:auto,dirty_decay_ms:-1,muzzy_decay_ms:0,oversize_threshold:0,narenas:4";

namespace selenograph::engine {

std::size_t free_memory_bytes() {
  std::uint64_t epoch = 1;  // as of now
  std::size_t bytes = sizeof epoch, resident = 0, active = 0, metadata = 0;
  ::mallctl("epoch", &epoch, &bytes, &epoch, bytes);
  bytes = sizeof resident;
  ::mallctl("stats.resident", &resident, &bytes, nullptr, 0);
  ::mallctl("stats.active", &active, &bytes, nullptr, 0);
  ::mallctl("stats.metadata", &metadata, &bytes, nullptr, 0);
  return resident - std::min(resident, active + metadata);
}

void give_back_free_memory() {
  ::mallctl("thread.tcache.flush", nullptr, nullptr, nullptr, 0);
  ::mallctl(("arena." + std::to_string(MALLCTL_ARENAS_ALL) + ".purge").c_str(), nullptr, nullptr, nullptr, 0);
}

}  // namespace selenograph::engine

#else

namespace selenograph::engine {

std::size_t free_memory_bytes() { return 0; }
void give_back_free_memory() {}

}  // namespace selenograph::engine

#endif
