#include "api/message/admission.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "api/message/problem.h"

namespace selenograph::api {
namespace {

// A disconnect only sets a flag and notifies no condition variable, so that waiting requests poll the flag.
constexpr double kPollInterval_ms = 50;
constexpr double kNewestWeight = 0.2;  // weight of the latest duration in the moving average

}  // namespace

Admission::Permit& Admission::Permit::operator=(Permit&& source) noexcept {
  std::swap(admission_, source.admission_);
  std::swap(bytes_, source.bytes_);
  std::swap(has_slot_, source.has_slot_);
  std::swap(since_, source.since_);
  return *this;
}

Admission::Permit::~Permit() { finish(0); }

void Admission::Permit::finish(std::size_t bytes) {
  if (!admission_) return;
  admission_->release(std::exchange(bytes_, bytes), bytes, std::exchange(has_slot_, false), Clock::now() - since_);
}

Admission::Permit Admission::enter(const std::string& client, std::size_t bytes, const StopToken& stop) {
  std::unique_lock lock(mutex_);
  if (closing_) throw RequestError("shutting_down", "the service is about to stop");
  // A request that fits joins the queue nevertheless while another one that fits waits: the slot is for that one.
  if (in_work_ >= limits_.max_in_work || !fits(bytes) || next()) {
    if (!fits_queue(client))
      throw RequestError("busy", "server at capacity: slots or memory, and all queue places, are taken");
    wait(client, bytes, stop, lock);
  }
  ++in_work_;
  bytes_in_use_ += bytes;
  return {this, bytes, true};
}

// Queues the request until it is its turn. Clients take turns: one whose first request arrives, and one that has just
// been admitted, draws the next turn, behind all others.
void Admission::wait(const std::string& client, std::size_t bytes, const StopToken& stop,
                     std::unique_lock<std::mutex>& lock) {
  const auto entry = clients_.try_emplace(client).first;
  Client& own_client = entry->second;
  if (own_client.waiting.empty()) own_client.turn = ++turns_;
  const auto own_request = own_client.waiting.insert(own_client.waiting.end(), bytes);
  ++waiting_;
  const auto leave = [&] {
    own_client.waiting.erase(own_request);
    --waiting_;
    if (own_client.waiting.empty()) clients_.erase(entry);
    // Wake the others: one may be next now and find a free slot, and wait_until_idle() waits for an empty queue.
    changed_.notify_all();
  };
  while (in_work_ >= limits_.max_in_work || next() != &*own_request) {
    if (stop.stopped()) {
      leave();
      throw Cancelled();
    }
    const double wait_ms = std::clamp(stop.remaining_ms(), 0.0, kPollInterval_ms);
    changed_.wait_for(lock, std::chrono::duration<double, std::milli>(wait_ms));
  }
  own_client.turn = ++turns_;
  leave();
}

Admission::Permit Admission::claim(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  if (!fits(bytes)) throw RequestError("busy", "the memory that this request takes is in use by others");
  bytes_in_use_ += bytes;
  return {this, bytes, false};
}

// Returns true if the client has fewer waiting requests than the queue has free places.
bool Admission::fits_queue(const std::string& client) const {
  const auto entry = clients_.find(client);
  const auto waiting = entry == clients_.end() ? 0 : static_cast<int>(entry->second.waiting.size());
  return waiting < limits_.max_waiting - waiting_;
}

bool Admission::fits(std::size_t bytes) const {
  return bytes <= limits_.max_bytes && bytes_in_use_ <= limits_.max_bytes - bytes;
}

// Returns the oldest request whose memory is free, of the client with the lowest turn that has one; null: none.
const std::size_t* Admission::next() const {
  const std::size_t* found = nullptr;
  std::uint64_t lowest_turn = std::numeric_limits<std::uint64_t>::max();
  for (const auto& [name, client] : clients_) {
    if (client.turn >= lowest_turn) continue;
    const auto request = std::ranges::find_if(client.waiting, [this](std::size_t bytes) { return fits(bytes); });
    if (request == client.waiting.end()) continue;
    found = &*request;
    lowest_turn = client.turn;
  }
  return found;
}

void Admission::release(std::size_t from_bytes, std::size_t to_bytes, bool has_slot, Clock::duration took) {
  const std::lock_guard lock(mutex_);
  bytes_in_use_ = bytes_in_use_ - from_bytes + to_bytes;
  if (has_slot) {
    --in_work_;
    mean_s_ += kNewestWeight * (std::chrono::duration<double>(took).count() - mean_s_);
  }
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

std::size_t Admission::bytes_in_use() const {
  const std::lock_guard lock(mutex_);
  return bytes_in_use_;
}

int Admission::retry_after_s() const {
  const std::lock_guard lock(mutex_);
  // The queue and one request more, if all slots work at the mean time per request.
  return static_cast<int>(std::clamp(std::ceil(mean_s_ * (waiting_ + 1) / limits_.max_in_work), 1.0, 120.0));
}

}  // namespace selenograph::api
