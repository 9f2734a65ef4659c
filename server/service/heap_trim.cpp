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

// In this time a flight takes some tens of megabytes more.
constexpr std::chrono::milliseconds kHeapLook{50};

}  // namespace

// proc(5): statm holds pages, the second number those in memory. Read without a stream, which allocates: this must not
// fail when there is no memory left.
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
  while (!stop_.wait_for(lock, kHeapLook, [this] { return stopping_; })) {
    try {
      look();
    } catch (const std::exception&) {  // no memory to count with: next time, then
    }
  }
}

void HeapTrim::look() {
  const std::size_t most = plan_.most_bytes(), free = engine::heap_statistics().free_bytes;
  std::size_t resident = resident_bytes(), less = less_;
  if (resident > most || (!plan_.keep_free && free > plan_.slack_bytes)) {
    engine::give_back_free_memory();
    resident = resident_bytes();
  } else if (plan_.keep_free) {
    resident -= std::min(resident, free);
  }
  if (resident > most) {
    less = std::min(less + (resident - most), plan_.most_less_bytes);
  } else if (most - resident > plan_.slack_bytes) {  // by and by
    less -= std::min(less, (most - resident - plan_.slack_bytes) / 8);
  }
  if (less != less_) plan_.keep_less(less_ = less);
}

}  // namespace selenograph::server
