#include "server/service/heap_trim.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <utility>

#include "engine/support/heap.h"

namespace selenograph::server {
namespace {

// A flight allocates some tens of megabytes in this time.
constexpr std::chrono::milliseconds kTrimInterval{50};

}  // namespace

// Reads the second number of statm, the resident pages (proc(5)). A stream would allocate, and this must work when
// there is no memory left.
std::size_t resident_bytes() {
  std::array<char, 128> text{};
  const int fd = ::open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  if (fd < 0) return 0;
  const ssize_t size = ::read(fd, text.data(), text.size() - 1);
  ::close(fd);
  const char* second = size > 0 ? std::strchr(text.data(), ' ') : nullptr;
  const unsigned long long pages = second ? std::strtoull(second, nullptr, 10) : 0;
  return static_cast<std::size_t>(pages) * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

HeapTrim::HeapTrim(Plan plan) : plan_(std::move(plan)), thread_([this] { run(); }) {}

HeapTrim::~HeapTrim() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  stop_.notify_one();
  thread_.join();
}

void HeapTrim::run() {
  std::unique_lock lock(mutex_);
  while (!stop_.wait_for(lock, kTrimInterval, [this] { return stopping_; })) {
    try {
      trim();
    } catch (const std::exception&) {  // no memory to count with: try again after the interval
    }
  }
}

// Compares the process with the plan once: first the heap gives back free pages, then the caches shrink or grow.
void HeapTrim::trim() {
  const std::size_t max_resident = plan_.max_resident_bytes();
  const std::size_t free = engine::heap_statistics().free_bytes;
  std::size_t resident = resident_bytes();
  if (resident > max_resident || (!plan_.keep_free && free > plan_.slack_bytes)) {
    engine::give_back_free_memory();
    resident = resident_bytes();
  } else if (plan_.keep_free) {
    // Prepared memory is resident on purpose: do not count it.
    resident -= std::min(resident, free);
  }
  std::size_t cut = cache_cut_bytes_;  // bytes that the caches keep less than their budgets
  if (resident > max_resident) {
    cut = std::min(cut + (resident - max_resident), plan_.max_cache_cut_bytes);
  } else if (max_resident - resident > plan_.slack_bytes) {
    // Grow back slowly: the caches would otherwise exceed the limit before the next comparison.
    cut -= std::min(cut, (max_resident - resident - plan_.slack_bytes) / 8);
  }
  if (cut == cache_cut_bytes_) return;
  cache_cut_bytes_ = cut;
  plan_.keep_less(cut);
}

}  // namespace selenograph::server
