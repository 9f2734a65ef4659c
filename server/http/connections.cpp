#include "server/http/connections.h"

#include <algorithm>
#include <utility>

namespace selenograph::server {
namespace {

// Interval at which connections at work are tested for clients that have disconnected.
constexpr auto kDetectionInterval = std::chrono::milliseconds(250);

}  // namespace

Connections::Connections(int max_connections)
    : max_connections_(max_connections), detection_([this] { detect_disconnected_clients(); }) {}

Connections::~Connections() {
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return threads_ == 0; });
    ending_ = true;
    changed_.notify_all();
  }
  detection_.join();
}

void Connections::start_thread(std::function<void()> serve) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return threads_ < max_sockets(max_connections_); });
  std::thread([this, serve = std::move(serve)] {
    serve();
    const std::lock_guard ended(mutex_);
    --threads_;
    changed_.notify_all();
  }).detach();
  ++threads_;
}

bool Connections::add(Connection& connection) {
  const std::lock_guard lock(mutex_);
  if (open() >= max_connections_ && !close_longest_waiting()) return false;
  connections_.push_back(&connection);
  return true;
}

void Connections::remove(Connection& connection) {
  const std::lock_guard lock(mutex_);
  connections_.remove(&connection);
}

// Gives up the connection that has waited longest. Returns false if no connection waits.
bool Connections::close_longest_waiting() {
  for (;;) {
    Connection* longest = nullptr;
    for (Connection* connection : connections_)
      if (connection->waiting() && (!longest || connection->since() < longest->since())) longest = connection;
    if (!longest) return false;
    if (longest->give_up()) return true;  // else a request has arrived on it meanwhile: search again
  }
}

int Connections::open() const {
  return static_cast<int>(std::count_if(connections_.begin(), connections_.end(),
                                        [](const Connection* connection) { return !connection->given_up(); }));
}

int Connections::size() const {
  const std::lock_guard lock(mutex_);
  return open();
}

void Connections::close_waiting() {
  const std::lock_guard lock(mutex_);
  for (Connection* connection : connections_) connection->give_up();
}

void Connections::cut() {
  const std::lock_guard lock(mutex_);
  for (Connection* connection : connections_) connection->cut();
}

bool Connections::wait_until_done(Connection::Clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  return changed_.wait_until(lock, deadline, [this] { return threads_ == 0; });
}

// Allocates nothing, because this thread must survive a lack of memory.
void Connections::detect_disconnected_clients() {
  std::unique_lock lock(mutex_);
  while (!ending_) {
    for (Connection* connection : connections_) connection->detect_disconnect();
    changed_.wait_for(lock, kDetectionInterval, [this] { return ending_; });
  }
}

}  // namespace selenograph::server
