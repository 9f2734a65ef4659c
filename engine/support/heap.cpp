#include "engine/support/heap.h"

// The sanitizers have allocators of their own.
#ifdef SELENOGRAPH_JEMALLOC

#include <jemalloc/jemalloc.h>

#include <algorithm>
#include <cstdint>

// Options that jemalloc reads as the process starts. Huge pages for everything. Pages that were free for ten minutes
// return to the system: each frame reuses the memory that the one before freed, also after a pause of the loop. One
// arena, because each keeps its own free memory, and large arrays are not allocated often enough to contend. Small
// arrays may be cut from free memory of any size, not only of up to 64 times theirs.
extern "C" const char* malloc_conf;
const char* malloc_conf =
    "thp:always,metadata_thp:auto,background_thread:true,dirty_decay_ms:600000,muzzy_decay_ms:0,oversize_threshold:0,"
    "narenas:1,"
    "lg_extent_max_active_fit:40";

namespace selenograph::engine {

namespace {

std::size_t statistic(const char* name) {
  std::size_t value = 0, size = sizeof value;
  ::mallctl(name, &value, &size, nullptr, 0);
  return value;
}

}  // namespace

HeapStatistics heap_statistics() {
  std::uint64_t epoch = 1;  // updates the statistics
  std::size_t size = sizeof epoch;
  ::mallctl("epoch", &epoch, &size, &epoch, size);
  const std::size_t resident = statistic("stats.resident"),
                    in_use = statistic("stats.active") + statistic("stats.metadata");
  return {statistic("stats.allocated"), resident - std::min(resident, in_use)};
}

}  // namespace selenograph::engine

#else

namespace selenograph::engine {

HeapStatistics heap_statistics() { return {}; }

}  // namespace selenograph::engine

#endif
