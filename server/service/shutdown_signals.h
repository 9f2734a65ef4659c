// SIGTERM and SIGINT as an event to wait for.
#pragma once

#include <atomic>
#include <chrono>
#include <future>
#include <thread>

namespace selenograph::server {

// Create it before any other thread: threads inherit the blocked signals. A second signal ends the process at once; so
// does the first before arm(), while there is nothing to finish. The process ends with status 1 `at_most` after the
// first signal, unless this object has been destroyed by then.
class ShutdownSignals {
 public:
  ShutdownSignals();
  ~ShutdownSignals();

  void arm(std::chrono::milliseconds at_most) {
    at_most_ = at_most;
    armed_ = true;
  }
  void wait() { first_.get_future().wait(); }  // until the first signal; once

 private:
  void run();
  int signals_ = -1, wake_ = -1;
  std::atomic<bool> armed_{false};
  std::atomic<std::chrono::milliseconds> at_most_{};
  std::promise<void> first_;
  std::thread thread_;
};

}  // namespace selenograph::server
