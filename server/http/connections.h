// All open connections of the service: a thread for each, their limit, and the detection of clients that disconnect.
//
// A connection that waits for its client (idle, or sending slowly) costs only a sleeping thread. At the limit of
// connections, the one that has waited longest is closed. If all are at work, a new client is refused.
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

  // Runs `serve` on a new thread, which calls add() and remove() for its connection. At twice as many threads as
  // connections this waits until one of a closed connection ends. Throws std::system_error.
  void start_thread(std::function<void()> serve);
  // Returns false, without adding the connection, if all connections are at work.
  bool add(Connection& connection);
  void remove(Connection& connection);

  int size() const;  // without connections that were given up
  // Closes the connections that wait for their clients.
  void close_waiting();
  // Ends all connections in any state.
  void cut();
  // Returns true once every thread has ended, and false at the deadline.
  bool wait_until_done(Connection::Clock::time_point deadline);

  // Maximum number of open sockets.
  static int max_sockets(int max_connections) { return 2 * max_connections; }

 private:
  bool close_longest_waiting();  // under mutex_
  int open() const;              // under mutex_
  void detect_disconnected_clients();

  const int max_connections_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::list<Connection*> connections_;
  int threads_ = 0;
  bool ending_ = false;
  std::thread detection_;
};

}  // namespace selenograph::server
