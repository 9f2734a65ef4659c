#include "server/service/admission.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace selenograph::server {
namespace {

// A client that leaves raises a flag and no condition variable; this is how soon its place in the queue is noticed.
constexpr auto kLook = std::chrono::milliseconds(50);
constexpr double kNewestWeight = 0.2;                           // of the latest duration in the moving average
constexpr auto kPromiseKept = std::chrono::seconds(5);          // after it is due
constexpr auto kPromiseEarly = std::chrono::milliseconds(100);  // who comes so much too early is in time
constexpr auto kPromiseSoon = std::chrono::seconds(2);          // later ones don't keep others out yet
constexpr std::size_t kMostPromises = 4096;                     // of one client

}  // namespace

Admission::Place::Place(Place&& other) noexcept
    : admission_(std::exchange(other.admission_, nullptr)), since_(other.since_) {}

Admission::Place::~Place() {
  if (admission_) admission_->leave(Clock::now() - since_);
}

Admission::Admission(const AdmissionLimits& limits) : limits_(limits) {}

Admission::Entry Admission::enter(const Visitor& visitor, Clock::time_point deadline,
                                  const std::atomic<bool>* abandoned) {
  std::unique_lock lock(mutex_);
  if (closing_) return {Outcome::closing, {}, come_back_after_s(ahead_of(nullptr))};
  newest_ = std::max(newest_, visitor.connection);
  forget_late_promises();
  if (in_work_ >= limits_.max_in_work || waiting_ > 0) {
    Entry entry = wait_in_queue(visitor, deadline, abandoned, lock);
    changed_.notify_all();  // the next in the queue may find a free place, or the queue may be empty
    if (entry.outcome != Outcome::admitted) return entry;
  } else if (const auto known = clients_.find(visitor.client); known != clients_.end()) {
    take_promise(known->second, visitor);
  }
  ++in_work_;
  return {Outcome::admitted, Place(this)};
}

Admission::Entry Admission::wait_in_queue(const Visitor& visitor, Clock::time_point deadline,
                                          const std::atomic<bool>* abandoned, std::unique_lock<std::mutex>& lock) {
  Waiting me;
  if (!join(client_of(visitor), visitor, me)) return {Outcome::full, {}, promise(visitor)};
  Outcome outcome = Outcome::admitted;
  while (in_work_ >= limits_.max_in_work || !is_next(&me)) {
    if (me.displaced) return {Outcome::full, {}, promise(visitor)};
    if (abandoned && *abandoned) outcome = Outcome::abandoned;
    if (Clock::now() >= deadline) outcome = Outcome::expired;
    if (outcome != Outcome::admitted) break;
    changed_.wait_until(lock, std::min(deadline, Clock::now() + kLook));
  }
  const auto client = clients_.find(visitor.client);
  client->second.waiting.remove(&me);
  --waiting_;
  if (outcome == Outcome::admitted) client->second.turn = ++turns_;
  if (client->second.size() == 0) clients_.erase(client);
  return {outcome, {}};
}

// A new one's turn comes after that of all who are here.
Admission::Client& Admission::client_of(const Visitor& visitor) {
  const auto [place, is_new] = clients_.try_emplace(visitor.client);
  if (is_new) place->second.turn = ++turns_;
  return place->second;
}

bool Admission::join(Client& client, const Visitor& visitor, Waiting& me) {
  const auto most = static_cast<std::size_t>(std::max(0, limits_.max_waiting));
  const bool promised = waiting_ < most && take_promise(client, visitor);
  if (!promised) {
    if (wait_s(ahead_of(&client)) > std::chrono::duration<double>(limits_.patience).count()) return false;
    if (waiting_ + promised_soon() >= most && !make_room_for(client)) return false;
  }
  client.waiting.push_back(&me);
  ++waiting_;
  return true;
}

bool Admission::take_promise(Client& client, const Visitor& visitor) {
  std::list<Promise>& promises = client.promises;
  const auto soon = Clock::now() + kPromiseEarly;
  auto mine = std::find_if(promises.begin(), promises.end(),
                           [&](const Promise& p) { return p.due < soon && p.connection == visitor.connection; });
  if (mine == promises.end()) {
    mine = std::find_if(promises.begin(), promises.end(),
                        [&](const Promise& p) { return p.due < soon && p.newest < visitor.connection; });
  }
  if (mine == promises.end()) return false;
  promises.erase(mine);
  return true;
}

// At the expense of the client that has most, if that is more than this one will have: of the place that it was
// promised, or of its newest request.
bool Admission::make_room_for(const Client& client) {
  const auto by_size = [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); };
  const auto by_waiting = [](const auto& a, const auto& b) {
    return a.second.waiting.size() < b.second.waiting.size();
  };
  const std::size_t mine = client.size() + 1;
  const auto most = static_cast<std::size_t>(std::max(0, limits_.max_waiting));
  if (waiting_ < most) return std::max_element(clients_.begin(), clients_.end(), by_size)->second.size() > mine;
  Client& largest = std::max_element(clients_.begin(), clients_.end(), by_waiting)->second;
  if (largest.waiting.size() <= mine) return false;
  largest.waiting.back()->displaced = true;
  largest.waiting.pop_back();
  --waiting_;
  changed_.notify_all();
  return true;
}

// Who asks again before it is due keeps what it has.
int Admission::promise(const Visitor& visitor) {
  Client& client = client_of(visitor);
  const auto now = Clock::now();
  for (const Promise& p : client.promises) {
    if (p.connection == visitor.connection && p.due > now)
      return static_cast<int>(std::chrono::ceil<std::chrono::seconds>(p.due - now).count());
  }
  const int after_s = come_back_after_s(ahead_of(&client));
  if (client.promises.size() < kMostPromises)
    client.promises.push_back({visitor.connection, newest_, now + std::chrono::seconds(after_s)});
  return after_s;
}

void Admission::forget_late_promises() {
  const auto late = Clock::now() - kPromiseKept;
  for (auto client = clients_.begin(); client != clients_.end();) {
    client->second.promises.remove_if([&](const Promise& p) { return p.due < late; });
    client = client->second.size() == 0 ? clients_.erase(client) : std::next(client);
  }
}

std::size_t Admission::promised_soon() const {
  const auto soon = Clock::now() + kPromiseSoon;
  std::size_t count = 0;
  for (const auto& [name, client] : clients_) {
    count += static_cast<std::size_t>(
        std::count_if(client.promises.begin(), client.promises.end(), [&](const Promise& p) { return p.due < soon; }));
  }
  return count;
}

bool Admission::is_next(const Waiting* me) const {
  const Client* next = nullptr;
  for (const auto& [name, client] : clients_) {
    if (!client.waiting.empty() && (!next || client.turn < next->turn)) next = &client;
  }
  return next && next->waiting.front() == me;
}

// Of a further request of this client (null: of one that has nothing here), clients taking turns.
std::size_t Admission::ahead_of(const Client* client) const {
  const std::size_t mine = client ? client->size() : 0;
  std::size_t ahead = mine;
  for (const auto& [name, other] : clients_) {
    if (&other != client) ahead += std::min(other.size(), mine + 1);
  }
  return ahead;
}

double Admission::wait_s(std::size_t ahead) const {
  return mean_s_ * static_cast<double>(ahead + 1) / limits_.max_in_work;
}

// No more come back within a second than the queue holds.
int Admission::come_back_after_s(std::size_t ahead) const {
  const double spread_s = static_cast<double>(ahead + 1) / (limits_.max_waiting + limits_.max_in_work);
  return static_cast<int>(std::clamp(std::ceil(std::max(wait_s(ahead), spread_s)), 1.0, 120.0));
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
  return changed_.wait_until(lock, deadline, [&] { return in_work_ == 0 && waiting_ == 0; });
}

int Admission::in_work() const {
  const std::lock_guard lock(mutex_);
  return in_work_;
}

int Admission::waiting() const {
  const std::lock_guard lock(mutex_);
  return static_cast<int>(waiting_);
}

int Admission::retry_after_s() const {
  const std::lock_guard lock(mutex_);
  return come_back_after_s(ahead_of(nullptr));
}

}  // namespace selenograph::server
