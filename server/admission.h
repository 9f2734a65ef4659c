// Who may render now: a bounded number of requests in work, a bounded queue behind them, first come first served.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <list>
#include <mutex>

namespace selenograph::server {

// All members may be called from any thread.
class Admission {
 public:
  using Clock = std::chrono::steady_clock;

  enum class Outcome {
    admitted,
    full,       // as many in work and waiting as there may be
    closing,    // close() was called
    expired,    // the deadline passed in the queue
    abandoned,  // the client left while queueing
  };

  // A place in work, given back on destruction. Empty unless the outcome is `admitted`.
  class Place {
   public:
    Place() = default;
    Place(Place&& other) noexcept;
    Place& operator=(Place&&) = delete;
    ~Place();

   private:
    friend class Admission;
    explicit Place(Admission* admission) : admission_(admission), since_(Clock::now()) {}
    Admission* admission_ = nullptr;
    Clock::time_point since_{};
  };

  struct Entry {
    Outcome outcome;
    Place place;
  };

  // max_in_work >= 1, max_waiting >= 0.
  Admission(int max_in_work, int max_waiting);

  // Waits in the queue until a place is free; no longer than the deadline, and not when `*abandoned` (null: never) is
  // true.
  Entry enter(Clock::time_point deadline, const std::atomic<bool>* abandoned);

  // Refuses newcomers from now on; those in work and in the queue go on.
  void close();
  // True once nobody is in work or waiting; false when the deadline comes first.
  bool wait_until_idle(Clock::time_point deadline);

  int in_work() const;
  int waiting() const;
  int max_in_work() const { return max_in_work_; }
  int max_waiting() const { return max_waiting_; }

  // When a newcomer may find a place, from recent durations and the length of the queue. Whole seconds, 1 to 120.
  int retry_after_s() const;

 private:
  void leave(Clock::duration took);

  const int max_in_work_, max_waiting_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::list<std::uint64_t> queue_;  // tickets; the front enters next
  std::uint64_t next_ticket_ = 0;
  int in_work_ = 0;
  bool closing_ = false;
  double mean_s_ = 0.5;  // of a place's use, moving average
};

}  // namespace selenograph::server
