// Memory budget for requests: bodies being received, active frames, answers not yet sent.
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

  // Bytes of the budget, returned on destruction.
  class Claim {
   public:
    Claim() = default;
    Claim(Claim&& other) noexcept;
    Claim& operator=(Claim&& other) noexcept;
    ~Claim();
    std::size_t bytes() const { return bytes_; }
    // Never waits: for memory that turned out smaller than claimed, or that exists already.
    void resize(std::size_t bytes);
    // For memory yet to be allocated. Never waits: false if the bytes are not free. A default-constructed claim has no
    // budget.
    bool try_resize(std::size_t bytes);

   private:
    friend class MemoryBudget;
    Claim(MemoryBudget* budget, std::size_t bytes) : budget_(budget), bytes_(bytes) {}
    MemoryBudget* budget_ = nullptr;
    std::size_t bytes_ = 0;
  };

  explicit MemoryBudget(std::size_t capacity_bytes = kUnbounded) : capacity_(capacity_bytes) {}

  // Never waits: nullopt if the bytes are not free.
  std::optional<Claim> try_claim(std::size_t bytes);
  // Waits until `until`, first come first served; nullopt when the bytes were not free by then. Throws Cancelled when
  // `stop` says so. More than capacity() never become free: check fits() first.
  std::optional<Claim> claim(std::size_t bytes, StopToken::Clock::time_point until, const StopToken& stop);
  bool fits(std::size_t bytes) const { return bytes <= capacity_; }

  std::size_t capacity() const { return capacity_; }
  std::size_t in_use() const;

 private:
  void resize(std::size_t from, std::size_t to);
  bool free_now(std::size_t bytes) const { return bytes <= capacity_ && in_use_ <= capacity_ - bytes; }

  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t in_use_ = 0;
  std::list<std::uint64_t> queue_;  // tickets; the front is served next
  std::uint64_t next_ticket_ = 0;
};

}  // namespace selenograph::api
