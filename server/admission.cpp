#include "server/admission.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace selenograph::server {
namespace {

// A client that leaves raises a flag and no condition variable; this is how soon its place in the queue is noticed.
constexpr auto kLook = std::chrono::milliseconds(50);
constexpr double kNewestWeight = 0.2;  // of the latest duration in the moving average

}  // namespace

Admission::Place::Place(Place&& other) noexcept
    : admission_(std::exchange(other.admission_, nullptr)), since_(other.since_) {}

Admission::Place::~Place() {
  if (admission_) admission_->leave(Clock::now() - since_);
}

Admission::Admission(int max_in_work, int max_waiting)
    : max_in_work_(std::max(1, max_in_work)), max_waiting_(std::max(0, max_waiting)) {}

Admission::Entry Admission::enter(Clock::time_point deadline, const std::atomic<bool>* abandoned) {
  std::unique_lock lock(mutex_);
  if (closing_) return {Outcome::closing, {}};
  const bool must_wait = in_work_ >= max_in_work_ || !queue_.empty();
  if (must_wait && static_cast<int>(queue_.size()) >= max_waiting_) return {Outcome::full, {}};

  const auto ticket = queue_.insert(queue_.end(), next_ticket_++);
  const auto my_turn = [&] { return in_work_ < max_in_work_ && queue_.front() == *ticket; };
  Outcome outcome = Outcome::admitted;
  while (!my_turn()) {
    if (abandoned && *abandoned) outcome = Outcome::abandoned;
    if (Clock::now() >= deadline) outcome = Outcome::expired;
    if (outcome != Outcome::admitted) break;
    changed_.wait_until(lock, std::min(deadline, Clock::now() + kLook));
  }
  queue_.erase(ticket);
  changed_.notify_all();  // the next in the queue may find a free place, or the queue may be empty
  if (outcome != Outcome::admitted) return {outcome, {}};
  ++in_work_;
  return {outcome, Place(this)};
}

void Admission::leave(Clock::duration took) {
  const std::lock_guard lock(mutex_);
  --in_work_;
  mean_s_ += kNewestWeight * (std::chrono::duration<double>(took).count() - mean_s_);
  changed_.notify_all();
}

void Admission::close() {
  const std::lock_guard lock(mutex_);
  closing_ = true;
}

bool Admission::wait_until_idle(Clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  return changed_.wait_until(lock, deadline, [&] { return in_work_ == 0 && queue_.empty(); });
}

int Admission::in_work() const {
  const std::lock_guard lock(mutex_);
  return in_work_;
}

int Admission::waiting() const {
  const std::lock_guard lock(mutex_);
  return static_cast<int>(queue_.size());
}

int Admission::retry_after_s() const {
  const std::lock_guard lock(mutex_);
  const double ahead = static_cast<double>(queue_.size()) + 1.0;
  return static_cast<int>(std::clamp(std::ceil(mean_s_ * ahead / max_in_work_), 1.0, 120.0));
}

}  // namespace selenograph::server
