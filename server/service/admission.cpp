#include "server/service/admission.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace selenograph::server {
namespace {

// A disconnect only sets a flag and notifies no condition variable, so that waiting requests poll the flag.
constexpr auto kPollInterval = std::chrono::milliseconds(50);
constexpr double kNewestWeight = 0.2;  // weight of the latest duration in the moving average

}  // namespace

Admission::Slot::Slot(Slot&& source) noexcept
    : admission_(std::exchange(source.admission_, nullptr)), since_(source.since_) {}

Admission::Slot::~Slot() {
  if (admission_) admission_->leave(Clock::now() - since_);
}

Admission::Entry Admission::enter(const std::string& client, Clock::time_point deadline,
                                  const std::atomic<bool>* abandoned) {
  std::unique_lock lock(mutex_);
  if (closing_) return {Outcome::closing, {}, estimate_s()};
  // While requests wait, a new one joins the queue even if a slot is free: the slot is for one of them.
  if (in_work_ >= limits_.max_in_work || waiting_ > 0) {
    if (!fits_queue(client)) return {Outcome::full, {}, estimate_s()};
    const Outcome outcome = wait(client, deadline, abandoned, lock);
    // Wake the others: one may be next now and find a free slot, and wait_until_idle() waits for an empty queue.
    changed_.notify_all();
    if (outcome != Outcome::admitted) return {outcome, {}};
  }
  ++in_work_;
  return {Outcome::admitted, Slot(this)};
}

// Queues the request until it has a slot to take or gives up. Clients take turns: one whose first request arrives, and
// one that has just been admitted, draws the next turn, behind all others.
Admission::Outcome Admission::wait(const std::string& client, Clock::time_point deadline,
                                   const std::atomic<bool>* abandoned, std::unique_lock<std::mutex>& lock) {
  const auto entry = clients_.try_emplace(client).first;
  Client& own_client = entry->second;
  if (own_client.waiting.empty()) own_client.turn = ++turns_;
  // Any address of this call identifies its request: take that of `lock`.
  const auto own_request = own_client.waiting.insert(own_client.waiting.end(), &lock);
  ++waiting_;
  Outcome outcome = Outcome::admitted;
  while (in_work_ >= limits_.max_in_work || !is_next(&lock)) {
    if (abandoned && *abandoned) outcome = Outcome::abandoned;
    if (Clock::now() >= deadline) outcome = Outcome::expired;
    if (outcome != Outcome::admitted) break;
    changed_.wait_until(lock, std::min(deadline, Clock::now() + kPollInterval));
  }
  own_client.waiting.erase(own_request);
  --waiting_;
  if (outcome == Outcome::admitted) own_client.turn = ++turns_;
  if (own_client.waiting.empty()) clients_.erase(entry);
  return outcome;
}

// Returns true if the client has fewer waiting requests than the queue has free places.
bool Admission::fits_queue(const std::string& client) const {
  const auto entry = clients_.find(client);
  const auto waiting = entry == clients_.end() ? 0 : static_cast<int>(entry->second.waiting.size());
  return waiting < limits_.max_waiting - waiting_;
}

// Returns true for the oldest request of the client with the lowest turn.
bool Admission::is_next(const void* request) const {
  const auto next = std::min_element(clients_.begin(), clients_.end(),
                                     [](const auto& a, const auto& b) { return a.second.turn < b.second.turn; });
  return next->second.waiting.front() == request;
}

// Returns the time for the queue and one request more, if all slots work at the mean time per request.
int Admission::estimate_s() const {
  return static_cast<int>(std::clamp(std::ceil(mean_s_ * (waiting_ + 1) / limits_.max_in_work), 1.0, 120.0));
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
  return changed_.wait_until(lock, deadline, [this] { return in_work_ == 0 && waiting_ == 0; });
}

int Admission::in_work() const {
  const std::lock_guard lock(mutex_);
  return in_work_;
}

int Admission::waiting() const {
  const std::lock_guard lock(mutex_);
  return waiting_;
}

int Admission::retry_after_s() const {
  const std::lock_guard lock(mutex_);
  return estimate_s();
}

}  // namespace selenograph::server
