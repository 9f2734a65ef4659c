// Cancellation of work: by a deadline, or when nobody waits for it any more.
#pragma once

#include <atomic>
#include <chrono>
#include <limits>

#include "dem/base/error.h"
#include "dem/base/wait_clock.h"

namespace selenograph {

// Polled wherever a loop's length depends on a request: check() throws Cancelled once it is time.
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
  // Infinite without a deadline, negative when it has passed.
  double remaining_ms() const {
    if (deadline_ == Clock::time_point::max()) return std::numeric_limits<double>::infinity();
    return std::chrono::duration<double, std::milli>(deadline_ - Clock::now()).count();
  }
  void check() const {
    if (stopped()) throw Cancelled();
  }

  // A copy that counts waits.
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
