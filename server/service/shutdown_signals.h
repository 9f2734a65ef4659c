// SIGTERM, SIGINT and SIGHUP as an event to wait for.
#pragma once

#include <chrono>

namespace selenograph::server {

// At most one object exists, on the main thread. A second signal ends the process at once; so does the first before
// arm(), while there is nothing to finish. The process ends with status 1 at `time_limit` after wait() has returned,
// unless this object has been destroyed by then: after that signals are ignored.
class ShutdownSignals {
 public:
  ShutdownSignals();
  ~ShutdownSignals();

  void arm(std::chrono::milliseconds time_limit);
  void wait() const;  // for the first signal

 private:
  std::chrono::milliseconds time_limit_{};
};

}  // namespace selenograph::server
