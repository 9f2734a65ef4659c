#include "engine/support/heap.h"

// The sanitizers have allocators of their own.
#ifdef SELENOGRAPH_JEMALLOC

#include <jemalloc/jemalloc.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "dem/base/parallel.h"

// Options that jemalloc reads as the process starts. Huge pages for everything. Free pages are kept until
// give_back_free_memory(), also those of large arrays. One arena, because each keeps its own free memory, and large
// arrays are not allocated often enough to contend. Small arrays may be cut from free memory of any size, not only of
// up to 64 times theirs.
extern "C" const char* malloc_conf;
const char* malloc_conf =
    "thp:always,metadata_thp:auto,dirty_decay_ms:-1,muzzy_decay_ms:0,oversize_threshold:0,narenas:1,"
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

void give_back_free_memory() {
  ::mallctl("thread.tcache.flush", nullptr, nullptr, nullptr, 0);
  ::mallctl(("arena." + std::to_string(MALLCTL_ARENAS_ALL) + ".purge").c_str(), nullptr, nullptr, nullptr, 0);
}

bool touch_memory(std::size_t bytes) {
  constexpr std::size_t kPiece = std::size_t{32} << 20, kPage = 4096;
  const auto free_pieces = [](std::vector<void*>& pieces) {
    for (void* piece : pieces) ::sdallocx(piece, kPiece, MALLOCX_TCACHE_NONE);
  };
  std::vector<void*> pieces;
  for (std::size_t allocated = 0; allocated + kPiece <= bytes; allocated += kPiece) {
    void* const piece = ::mallocx(kPiece, MALLOCX_TCACHE_NONE);
    if (!piece) {
      free_pieces(pieces);
      return false;
    }
    pieces.push_back(piece);
  }
  in_parallel(pieces.size(), [&](std::size_t i) {
    auto* const piece = static_cast<volatile char*>(pieces[i]);
    // Write to each page: the system allocates it on the first write.
    for (std::size_t at = 0; at < kPiece; at += kPage) piece[at] = 0;
  });
  free_pieces(pieces);
  return true;
}

}  // namespace selenograph::engine

#else

namespace selenograph::engine {

HeapStatistics heap_statistics() { return {}; }
void give_back_free_memory() {}
bool touch_memory(std::size_t) { return true; }

}  // namespace selenograph::engine

#endif
