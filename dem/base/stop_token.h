// Cancellation of work: by a deadline, or by a flag when no caller waits for the result any more.
#pragma once

#include <atomic>
#include <chrono>
#include <limits>

#include "dem/base/error.h"
#include "dem/base/wait_clock.h"

namespace selenograph {

// Work polls it in every loop whose length depends on a request: check() throws Cancelled after the deadline.
class StopToken {
 public:
  using Clock = std::chrono::steady_clock;
  StopToken() = default;  // never stops
  explicit StopToken(Clock::time_point deadline) : deadline_(deadline) {}
  StopToken(Clock::time_point deadline, const std::atomic<bool>* abandoned)
      : deadline_(deadline), abandoned_(abandoned) {}
  bool stopped() const {
    return (abandoned_ && abandoned_->load(std::memory_order_relaxed)) ||
           (deadline_ != Clock::time_point::max() && Clock::now() >= deadline_);
  }
  // Returns the time to the deadline: infinite without one, negative after it.
  double remaining_ms() const {
    if (deadline_ == Clock::time_point::max()) return std::numeric_limits<double>::infinity();
    return std::chrono::duration<double, std::milli>(deadline_ - Clock::now()).count();
  }
  void check() const {
    if (stopped()) throw Cancelled();
  }

  // Returns a copy that adds waiting times to `waits`.
  StopToken counting(Waits& waits) const {
    StopToken token = *this;
    token.waits_ = &waits;
    return token;
  }
  Waits* waits() const { return waits_; }  // may be null

 private:
  Clock::time_point deadline_ = Clock::time_point::max();
  const std::atomic<bool>* abandoned_ = nullptr;
  Waits* waits_ = nullptr;
};

}  // namespace selenograph
