#include "server/heap_trim.h"

#include <fcntl.h>
#include <malloc.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <utility>

namespace selenograph::server {
namespace {

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

}  // namespace

HeapTrim::HeapTrim(std::function<std::size_t()> held_bytes, std::size_t slack_bytes)
    : held_bytes_(std::move(held_bytes)),
      slack_bytes_(slack_bytes),
      start_bytes_(resident_bytes()),
      thread_([this] { run(); }) {
  // What a frame gives back, the next one takes: going through the system and its zeroed pages in between costs half a
  // millisecond of 20.
  ::mallopt(M_MMAP_THRESHOLD, 64 << 20);
  ::mallopt(M_TRIM_THRESHOLD, 512 << 20);
}

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
  while (!stop_.wait_for(lock, std::chrono::seconds(1), [this] { return stopping_; })) {
    try {
      if (resident_bytes() > start_bytes_ + held_bytes_() + slack_bytes_) ::malloc_trim(0);
    } catch (const std::exception&) {  // no memory to count with: a second later, then
    }
  }
}

}  // namespace selenograph::server
