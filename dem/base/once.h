// One-time initialisation.
#pragma once

#include <atomic>
#include <mutex>

namespace selenograph::dem {

// Like std::call_once, for functions that may throw: then the next caller tries again. (With std::call_once the next
// caller would wait forever where pthread_once does not let exceptions through: GCC's bug 66146, ThreadSanitizer.)
class Once {
 public:
  bool done() const { return done_.load(std::memory_order_acquire); }
  template <typename Work>
  void run(Work&& work) {
    if (done()) return;
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
