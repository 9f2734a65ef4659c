// SIGTERM, SIGINT and SIGHUP as an event to wait for.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <future>
#include <thread>

namespace selenograph::server {

// At most one object exists. Create it before any other thread of this program: threads inherit the blocked signals, so
// that no signal interrupts their system calls. A second signal ends the process at once; so does the first before
// arm(), while there is nothing to finish. The process ends with status 1 at `time_limit` after the first signal,
// unless this object has been destroyed by then: after that signals are ignored.
class ShutdownSignals {
 public:
  ShutdownSignals();
  ~ShutdownSignals();

  void arm(std::chrono::milliseconds time_limit) {
    time_limit_ = time_limit;
    armed_ = true;
  }
  // Waits for the first signal. Call it once.
  void wait() { first_.get_future().wait(); }

 private:
  void run();
  std::array<int, 2> pipe_{-1, -1};
  std::atomic<bool> armed_{false};
  std::atomic<std::chrono::milliseconds> time_limit_{};
  std::promise<void> first_;
  std::thread thread_;
};

}  // namespace selenograph::server
