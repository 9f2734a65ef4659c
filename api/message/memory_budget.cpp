#include "api/message/memory_budget.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace selenograph::api {
namespace {

// Interval at which waiting threads check their StopToken: a deadline or a client that disconnects notifies no
// condition variable.
constexpr auto kPollInterval = std::chrono::milliseconds(50);

}  // namespace

MemoryBudget::Claim::Claim(Claim&& source) noexcept
    : budget_(std::exchange(source.budget_, nullptr)), bytes_(std::exchange(source.bytes_, 0)) {}

MemoryBudget::Claim& MemoryBudget::Claim::operator=(Claim&& source) noexcept {
  std::swap(budget_, source.budget_);
  std::swap(bytes_, source.bytes_);
  return *this;
}

MemoryBudget::Claim::~Claim() {
  if (budget_) budget_->resize(bytes_, 0);
}

void MemoryBudget::Claim::resize(std::size_t bytes) {
  if (!budget_) return;
  budget_->resize(bytes_, bytes);
  bytes_ = bytes;
}

bool MemoryBudget::Claim::try_resize(std::size_t bytes) {
  if (!budget_) return bytes == 0;
  if (bytes > bytes_) {
    auto extra = budget_->try_claim(bytes - bytes_);
    if (!extra) return false;
    extra->budget_ = nullptr;  // transfers its bytes to this claim: its destructor must not release them
  } else {
    budget_->resize(bytes_, bytes);
  }
  bytes_ = bytes;
  return true;
}

// Replaces a claim of `from` bytes by one of `to` bytes, free or not.
void MemoryBudget::resize(std::size_t from, std::size_t to) {
  const std::lock_guard lock(mutex_);
  in_use_ = in_use_ - from + to;
  changed_.notify_all();
}

std::optional<MemoryBudget::Claim> MemoryBudget::try_claim(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  if (!queue_.empty() || !are_free(bytes)) return std::nullopt;
  in_use_ += bytes;
  return Claim(this, bytes);
}

std::optional<MemoryBudget::Claim> MemoryBudget::claim(std::size_t bytes, StopToken::Clock::time_point until,
                                                       const StopToken& stop) {
  std::unique_lock lock(mutex_);
  // Leaves the queue on every exit, and wakes the thread that is then at the front. Destroyed while `lock` is held.
  struct Ticket {
    std::list<std::uint64_t>& queue;
    std::condition_variable& changed;
    std::list<std::uint64_t>::iterator position;
    ~Ticket() {
      queue.erase(position);
      changed.notify_all();
    }
  } ticket{queue_, changed_, queue_.insert(queue_.end(), next_ticket_++)};
  while (queue_.front() != *ticket.position || !are_free(bytes)) {
    stop.check();
    const auto now = StopToken::Clock::now();
    if (now >= until) return std::nullopt;
    changed_.wait_until(lock, std::min(until, now + kPollInterval));
  }
  in_use_ += bytes;
  return Claim(this, bytes);
}

std::size_t MemoryBudget::in_use() const {
  const std::lock_guard lock(mutex_);
  return in_use_;
}

}  // namespace selenograph::api
