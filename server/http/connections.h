// All open connections of the service: their threads, their number, and clients that leave.
//
// A connection that only waits for its client (idle, or sending slowly) costs a sleeping thread and nothing else. At
// the limit of connections, the one that has waited longest is closed. If all are at work, a new client is refused.
#pragma once

#include <condition_variable>
#include <functional>
#include <list>
#include <mutex>
#include <thread>

#include "server/http/connection.h"

namespace selenograph::server {

class Connections {
 public:
  explicit Connections(int max_connections);
  ~Connections();  // waits for all threads

  // Runs `serve` on a thread of its own; the connection's thread adds and removes it. At twice as many threads as
  // connections this waits: threads of closed connections are about to end. Throws std::system_error.
  void start_thread(std::function<void()> serve);
  // False: every connection is at work, and this one was not added.
  bool add(Connection& connection);
  void remove(Connection& connection);

  int size() const;  // without those that were given up
  // Closes the connections that wait for their clients.
  void close_waiting();
  // Ends all connections in any state.
  void cut();
  // True once every thread has ended; false if the deadline comes first.
  bool wait_until_done(Connection::Clock::time_point deadline);

  // Maximum number of open sockets.
  static int max_sockets(int max_connections) { return 2 * max_connections; }

 private:
  bool make_room();  // under mutex_
  int open() const;  // under mutex_
  void watch();

  const int max_connections_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::list<Connection*> connections_;
  int threads_ = 0;
  bool ending_ = false;
  std::thread watch_;
};

}  // namespace selenograph::server
