// Accepts connections and gives each a thread of its own; no HTTP here.
//
// A connection that only waits for its client (idle, or sending slowly) costs a sleeping thread and nothing else, and
// is the first to go when the number of connections reaches its bound: silent clients can't keep others out.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "server/connection.h"

namespace selenograph::server {

class Listener {
 public:
  using Serve = std::function<void(Connection&)>;  // returns when the connection is done with; must not throw

  // Binds and listens. `host` is a name or address, IPv4 or IPv6; port 0 takes a free one. `busy_answer` is sent to a
  // client for whom there is no room. Throws std::runtime_error saying what can't be bound and why.
  Listener(const std::string& host, int port, int max_connections, std::string busy_answer);
  ~Listener();

  int port() const { return port_; }
  int connections() const;  // without those that were given up
  bool stopping() const { return stopping_.load(); }

  // Accepts until stop(); returns when the last connection is done. Once only.
  void run(const Serve& serve);
  // From any thread: accept no more, give up those that wait for their client.
  void stop();

 private:
  struct Client;
  void accept_one(const Serve& serve);
  void start(int fd, const Serve& serve);
  void reap();
  bool find_room();
  int kept() const;  // under mutex_
  bool give_up_oldest();
  void wake();

  int socket_ = -1, wake_ = -1;
  int port_ = 0;
  const int max_connections_;
  const std::string busy_answer_;
  std::atomic<bool> stopping_{false};
  mutable std::mutex mutex_;  // of clients_
  std::condition_variable closed_;
  std::list<Client> clients_;
};

}  // namespace selenograph::server
