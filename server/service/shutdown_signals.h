// SIGTERM, SIGINT and SIGHUP as an event to wait for.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <future>
#include <thread>

namespace selenograph::server {

// One at a time. Create it before any other thread of this program: threads inherit the blocked signals, and no call of
// theirs is interrupted. A second signal ends the process at once; so does the first before arm(), while there is
// nothing to finish. The process ends with status 1 `at_most` after the first signal, unless this object has been
// destroyed by then: after that signals are ignored.
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
  std::array<int, 2> pipe_{-1, -1};
  std::atomic<bool> armed_{false};
  std::atomic<std::chrono::milliseconds> at_most_{};
  std::promise<void> first_;
  std::thread thread_;
};

}  // namespace selenograph::server
