// One-time initialisation.
#pragma once

#include <atomic>
#include <mutex>

namespace selenograph::dem {

// Runs a function once, like std::call_once. If the function throws, the next caller runs it again. With std::call_once
// that caller would wait forever where pthread_once does not propagate exceptions (GCC bug 66146, ThreadSanitizer).
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
