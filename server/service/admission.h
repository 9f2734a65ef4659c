// Admission control: a semaphore with a bounded queue in which clients take turns.
//
// | a request is | from                                                     | until                                |
// |--------------|----------------------------------------------------------|--------------------------------------|
// | admitted     | a slot is free and no earlier turn waits for it          | its Slot is destroyed                |
// | waiting      | all slots are taken, and its client has fewer waiting    | it is admitted, its deadline passes, |
// |              | requests than the queue has free places                  | or its client leaves                 |
// | full         | else: 503, with an estimated Retry-After                 |                                      |
// | closing      | close() was called: 503                                  |                                      |
//
// A client is an address or a token. Its oldest request is next, and after each admitted request the turn passes to the
// next client: 200 requests of one delay the single request of another by one request. One client alone may fill half
// of the queue, two a third each, and so on: a place remains for a newcomer.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <list>
#include <map>
#include <mutex>
#include <string>

namespace selenograph::server {

struct AdmissionLimits {
  int max_in_work = 1;  // at least 1
  int max_waiting = 0;
};

// Thread-safe.
class Admission {
 public:
  using Clock = std::chrono::steady_clock;

  enum class Outcome {
    admitted,
    full,       // see Entry::retry_after_s
    closing,    // close() was called
    expired,    // the deadline passed in the queue
    abandoned,  // the client left while queueing
  };

  // Permission to work, returned on destruction. Empty unless the outcome is `admitted`.
  class Slot {
   public:
    Slot() = default;
    Slot(Slot&& source) noexcept;
    Slot& operator=(Slot&&) = delete;
    ~Slot();

   private:
    friend class Admission;
    explicit Slot(Admission* admission) : admission_(admission), since_(Clock::now()) {}
    Admission* admission_ = nullptr;
    Clock::time_point since_{};
  };

  struct Entry {
    Outcome outcome;
    Slot slot;
    int retry_after_s = 0;  // set for `full` and `closing`
  };

  explicit Admission(const AdmissionLimits& limits) : limits_(limits) {}

  // Waits in the queue until a slot is free, the deadline passes or `*abandoned` is set (null: never).
  Entry enter(const std::string& client, Clock::time_point deadline, const std::atomic<bool>* abandoned);

  // Refuses new requests from now on; active and queued ones continue.
  void close();
  // Returns true once no request is active or queued, and false at the deadline.
  bool wait_until_idle(Clock::time_point deadline);

  int in_work() const;
  int waiting() const;
  int max_in_work() const { return limits_.max_in_work; }
  int max_waiting() const { return limits_.max_waiting; }

  // Returns the estimated time until the waiting requests are done. Whole seconds, 1 to 120.
  int retry_after_s() const;

 private:
  struct Client {
    std::list<const void*> waiting;  // oldest first
    std::uint64_t turn = 0;          // drawn on arrival and for each admitted request: the lowest is next
  };

  void leave(Clock::duration took);
  Outcome wait(const std::string& client, Clock::time_point deadline, const std::atomic<bool>* abandoned,
               std::unique_lock<std::mutex>& lock);
  bool fits_queue(const std::string& client) const;
  bool is_next(const void* request) const;
  int estimate_s() const;

  const AdmissionLimits limits_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, Client> clients_;  // those with waiting requests
  int waiting_ = 0;
  int in_work_ = 0;
  std::uint64_t turns_ = 0;
  bool closing_ = false;
  double mean_s_ = 0.5;  // moving average of the time per request
};

}  // namespace selenograph::server
