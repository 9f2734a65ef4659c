// Memory budget for requests: bodies being received, active frames, answers not yet sent. It counts bytes only; callers
// claim them before they allocate.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <list>
#include <mutex>
#include <optional>

#include "dem/base/stop_token.h"

namespace selenograph::api {

// Thread-safe. It must outlive its claims.
class MemoryBudget {
 public:
  static constexpr std::size_t kUnbounded = std::numeric_limits<std::size_t>::max();

  // Bytes of the budget, released on destruction. A default-constructed claim has no budget and no bytes.
  class Claim {
   public:
    Claim() = default;
    Claim(Claim&& source) noexcept;
    Claim& operator=(Claim&& source) noexcept;
    ~Claim();
    std::size_t bytes() const { return bytes_; }
    // Changes the claim without a check or a wait, for memory that is smaller than claimed or is already allocated.
    void resize(std::size_t bytes);
    // Changes the claim for memory yet to be allocated. Returns false without waiting if the bytes are not free.
    bool try_resize(std::size_t bytes);

   private:
    friend class MemoryBudget;
    Claim(MemoryBudget* budget, std::size_t bytes) : budget_(budget), bytes_(bytes) {}
    MemoryBudget* budget_ = nullptr;
    std::size_t bytes_ = 0;
  };

  explicit MemoryBudget(std::size_t capacity_bytes = kUnbounded) : capacity_(capacity_bytes) {}

  // Claims bytes; returns empty without waiting if they are not free or threads are waiting in the queue.
  std::optional<Claim> try_claim(std::size_t bytes);
  // Claims bytes and waits for them at most until `until`, first come first served; returns empty if they were not free
  // by then. Throws Cancelled when `stop` is requested. More than capacity() never become free: check fits() first.
  std::optional<Claim> claim(std::size_t bytes, StopToken::Clock::time_point until, const StopToken& stop);
  bool fits(std::size_t bytes) const { return bytes <= capacity_; }

  std::size_t capacity() const { return capacity_; }
  std::size_t in_use() const;

 private:
  void resize(std::size_t from, std::size_t to);
  bool are_free(std::size_t bytes) const { return bytes <= capacity_ && in_use_ <= capacity_ - bytes; }

  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;  // notified when bytes are released or the queue's front leaves
  std::size_t in_use_ = 0;
  std::list<std::uint64_t> queue_;  // tickets of waiting threads; the front is served next
  std::uint64_t next_ticket_ = 0;
};

}  // namespace selenograph::api
