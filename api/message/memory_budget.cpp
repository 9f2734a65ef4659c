#include "api/message/memory_budget.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace selenograph::api {
namespace {

// A deadline or a client that leaves wakes no condition variable; this is how soon either is noticed.
constexpr auto kLook = std::chrono::milliseconds(50);

}  // namespace

MemoryBudget::Claim::Claim(Claim&& other) noexcept
    : budget_(std::exchange(other.budget_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}

MemoryBudget::Claim& MemoryBudget::Claim::operator=(Claim&& other) noexcept {
  std::swap(budget_, other.budget_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

MemoryBudget::Claim::~Claim() {
  if (budget_) budget_->resize(bytes_, 0);
}

void MemoryBudget::Claim::resize(std::size_t bytes) {
  if (budget_) budget_->resize(bytes_, bytes), bytes_ = bytes;
}

bool MemoryBudget::Claim::try_resize(std::size_t bytes) {
  if (!budget_) return bytes == 0;
  if (bytes > bytes_) {
    auto more = budget_->try_claim(bytes - bytes_);
    if (!more) return false;
    more->budget_ = nullptr;  // part of this one from now on
  } else {
    budget_->resize(bytes_, bytes);
  }
  bytes_ = bytes;
  return true;
}

void MemoryBudget::resize(std::size_t from, std::size_t to) {
  const std::lock_guard lock(mutex_);
  in_use_ = in_use_ - from + to;
  changed_.notify_all();
}

std::optional<MemoryBudget::Claim> MemoryBudget::try_claim(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  if (!queue_.empty() || !free_now(bytes)) return std::nullopt;
  in_use_ += bytes;
  return Claim(this, bytes);
}

std::optional<MemoryBudget::Claim> MemoryBudget::claim(std::size_t bytes, StopToken::Clock::time_point until,
                                                       const StopToken& stop) {
  std::unique_lock lock(mutex_);
  struct Ticket {
    std::list<std::uint64_t>& queue;
    std::condition_variable& changed;
    std::list<std::uint64_t>::iterator place;
    ~Ticket() {
      queue.erase(place);
      changed.notify_all();
    }
  } ticket{queue_, changed_, queue_.insert(queue_.end(), next_ticket_++)};
  while (queue_.front() != *ticket.place || !free_now(bytes)) {
    stop.check();
    const auto now = StopToken::Clock::now();
    if (now >= until) return std::nullopt;
    changed_.wait_until(lock, std::min(until, now + kLook));
  }
  in_use_ += bytes;
  return Claim(this, bytes);
}

std::size_t MemoryBudget::in_use() const {
  const std::lock_guard lock(mutex_);
  return in_use_;
}

}  // namespace selenograph::api
