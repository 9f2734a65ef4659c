// Accepts connections and gives each a thread of its own; no HTTP here.
//
// A connection that only waits for its client (idle, or sending slowly) costs a sleeping thread and nothing else, and
// is the first to go when the number of connections reaches its bound: silent clients can't keep others out. Then go
// clients that read their answer slowly. When all are at work,
//  - an address with less than its share (the bound over the addresses that are connected) is still let in, up to
//    extra_connections() more;
//  - health_connections() more get health and metrics only;
//  - anybody else gets the busy answer.
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include "server/http/connection.h"

namespace selenograph::server {

struct ListenerOptions {
  std::string host;  // a name or address, IPv4 or IPv6
  int port;          // 0: any free one
  int max_connections;
  SendPace pace;
  std::function<std::string()> busy_answer;  // for a client for whom there is no room
  std::string spare_answer;                  // the same when there is no memory to make one, or for a thread
};

class Listener {
 public:
  using Serve = std::function<void(Connection&)>;  // returns when the connection is done with; must not throw

  // Binds and listens. Throws std::runtime_error saying what can't be bound and why.
  explicit Listener(ListenerOptions options);
  ~Listener();

  int port() const { return port_; }
  int connections() const;  // without those that were given up
  bool stopping() const { return stopping_.load(); }

  // Accepts until stop(); returns when the last connection is done. Once only.
  void run(const Serve& serve);
  // From any thread: accept no more, give up those that wait for their client.
  void stop();
  // True once stop() was called and every connection is done; false when the deadline comes first.
  bool wait_until_done(Connection::Clock::time_point deadline);
  // Ends all connections, whatever they do.
  void cut();

  static int extra_connections(int max_connections);
  static int health_connections(int max_connections);
  // At once, in the worst case.
  static int most_sockets(int max_connections);

 private:
  struct Client;
  enum class Room { none, health_only, full };
  enum class Which { silent, any };
  void accept_one(const Serve& serve);
  void start(int fd, Peer peer, const Serve& serve);
  void refuse(int fd);
  void close_refused(Connection::Clock::time_point before);
  void reap();
  Room find_room(const std::string& address);
  Room room_for(const std::string& address);  // under mutex_
  int kept(bool reserved) const;              // under mutex_
  bool has_less_than_its_share(const std::string& address) const;
  bool give_up_oldest(Which which, bool reserved);
  bool give_up_slow_reader();
  void wake();

  const ListenerOptions options_;
  int socket_ = -1, wake_ = -1;
  int port_ = 0;
  std::uint64_t last_number_ = 0;  // of a connection
  std::atomic<bool> stopping_{false};
  // Refused clients may still be sending: closed at once, they would get a reset instead of the answer.
  std::deque<std::pair<Connection::Clock::time_point, int>> refused_;
  mutable std::mutex mutex_;  // of clients_
  std::condition_variable closed_;
  std::list<Client> clients_;
};

}  // namespace selenograph::server
