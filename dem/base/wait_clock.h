// Clocks of the times that a request waits.
#pragma once

#include <chrono>
#include <mutex>

namespace selenograph {

// Time during which at least one of a request's threads waits for a resource; simultaneous waits count once.
class WaitClock {
 public:
  using Clock = std::chrono::steady_clock;
  double ms() const {
    const std::lock_guard lock(mutex_);
    return std::chrono::duration<double, std::milli>(waited_).count();
  }

 private:
  friend class Waiting;
  void begin() {
    const std::lock_guard lock(mutex_);
    if (waiting_++ == 0) since_ = Clock::now();
  }
  void end() {
    const std::lock_guard lock(mutex_);
    if (--waiting_ == 0) waited_ += Clock::now() - since_;
  }

  mutable std::mutex mutex_;
  int waiting_ = 0;
  Clock::time_point since_{};
  Clock::duration waited_{};
};

struct Waits {
  WaitClock pyramid;  // waits for chunks to be read or built
  WaitClock load;     // waits for blocks to be loaded
};

// Counts its thread as waiting during its lifetime; `waits` may be null.
class Waiting {
 public:
  Waiting(Waits* waits, WaitClock Waits::*what) : clock_(waits ? &(waits->*what) : nullptr) {
    if (clock_) clock_->begin();
  }
  ~Waiting() {
    if (clock_) clock_->end();
  }
  Waiting(const Waiting&) = delete;
  Waiting& operator=(const Waiting&) = delete;

 private:
  WaitClock* clock_;
};

}  // namespace selenograph
