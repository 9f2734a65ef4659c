// Something that is done once, by whoever needs it first.
#pragma once

#include <atomic>
#include <mutex>

namespace selenograph::dem {

// std::call_once, but for what may throw: then it isn't done, and the next caller does it. (By std::call_once the next
// caller waits for ever wherever pthread_once does not let exceptions through: GCC's bug 66146, ThreadSanitizer.)
class Once {
 public:
  template <typename Work>
  void run(Work&& work) {
    if (done_.load(std::memory_order_acquire)) return;
    const std::lock_guard lock(mutex_);
    if (done_.load(std::memory_order_relaxed)) return;
    work();
    done_.store(true, std::memory_order_release);
  }

 private:
  std::mutex mutex_;
  std::atomic<bool> done_ = false;
};

}  // namespace selenograph::dem
