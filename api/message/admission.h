// Admission of requests: slots for work, memory, and a bounded queue in which clients take turns.
//
// | a request is | from                                                     | until                                  |
// |--------------|----------------------------------------------------------|----------------------------------------|
// | admitted     | its memory and a slot are free, and no earlier turn that | Permit::finish() returns the slot; the |
// |              | fits waits for them                                      | answer's memory stays until it is sent |
// | waiting      | else, if its client has fewer waiting requests than the  | it is admitted, its deadline passes,   |
// |              | queue has free places                                    | or its client leaves                   |
// | "busy"       | else                                                     |                                        |
//
// A client is an address or a token. Its oldest request is next, and after each admitted request the turn passes to the
// next client: 200 requests of one delay the single request of another by one request. One client alone may fill half
// of the queue, two a third each, and so on: a place remains for a newcomer. A request whose memory is not free holds
// neither slot nor turn: smaller ones pass it.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <list>
#include <map>
#include <mutex>
#include <string>
#include <utility>

#include "dem/base/stop_token.h"

namespace selenograph::api {

struct AdmissionLimits {
  int max_in_work = std::numeric_limits<int>::max();  // at least 1
  int max_waiting = 0;
  std::size_t max_bytes = std::numeric_limits<std::size_t>::max();
};

// Thread-safe. It must outlive its permits. It counts bytes only: callers are admitted before they allocate.
class Admission {
 public:
  using Clock = std::chrono::steady_clock;

  // Permission to work and to use memory, returned on destruction. A default-constructed permit has neither.
  class Permit {
   public:
    Permit() = default;
    Permit(Permit&& source) noexcept { *this = std::move(source); }
    Permit& operator=(Permit&& source) noexcept;
    ~Permit();
    // Returns the slot, and keeps `bytes` of memory, for the answer until it is sent.
    void finish(std::size_t bytes);
    explicit operator bool() const { return admission_ != nullptr; }

   private:
    friend class Admission;
    Permit(Admission* admission, std::size_t bytes, bool has_slot)
        : admission_(admission), bytes_(bytes), has_slot_(has_slot), since_(Clock::now()) {}
    Admission* admission_ = nullptr;
    std::size_t bytes_ = 0;
    bool has_slot_ = false;
    Clock::time_point since_{};
  };

  explicit Admission(const AdmissionLimits& limits = {}) : limits_(limits) {}

  // Waits in the queue until `bytes` and a slot are free. Throws Cancelled when `stop` is requested, and RequestError
  // "busy" without a place in the queue or "shutting_down" after close(). More than max_bytes never become free.
  Permit enter(const std::string& client, std::size_t bytes, const StopToken& stop);
  // Claims memory without slot and queue, for cheap requests. Throws RequestError "busy" if it is not free.
  Permit claim(std::size_t bytes);

  // Refuses new requests from now on; active and queued ones continue.
  void close();
  // Returns true once no request is active or queued, and false at the deadline.
  bool wait_until_idle(Clock::time_point deadline);

  int in_work() const;
  int waiting() const;
  std::size_t bytes_in_use() const;
  const AdmissionLimits& limits() const { return limits_; }

  // Returns the estimated time until the waiting requests are done. Whole seconds, 1 to 120.
  int retry_after_s() const;

 private:
  struct Client {
    std::list<std::size_t> waiting;  // bytes of its requests, oldest first
    std::uint64_t turn = 0;          // drawn on arrival and for each admitted request: the lowest is next
  };

  void wait(const std::string& client, std::size_t bytes, const StopToken& stop, std::unique_lock<std::mutex>& lock);
  bool fits_queue(const std::string& client) const;
  bool fits(std::size_t bytes) const;
  const std::size_t* next() const;
  void release(std::size_t from_bytes, std::size_t to_bytes, bool has_slot, Clock::duration took);

  const AdmissionLimits limits_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, Client> clients_;  // those with waiting requests
  int waiting_ = 0;
  int in_work_ = 0;
  std::size_t bytes_in_use_ = 0;
  std::uint64_t turns_ = 0;
  bool closing_ = false;
  double mean_s_ = 0.5;  // moving average of the time per request
};

}  // namespace selenograph::api
