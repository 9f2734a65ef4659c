// Accepts connections and gives each its own thread; independent of HTTP.
//
// A connection that only waits for its client (idle, or sending slowly) costs a sleeping thread and nothing else, and
// is the first to be closed at the limit of connections: silent clients cannot keep others out. Next are clients that
// read their response slowly. If all are at work,
//  - an address with less than its share (the limit over the number of connected addresses) is still accepted, up to
//    extra_connections() more;
//  - health_connections() more are served health and metrics only;
//  - then the oldest connection that waits for its client is closed, silent or not;
//  - if there is none, the new client gets the busy response.
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
  std::function<std::string()> busy_answer;  // answer to a client when the limit is reached
  std::string spare_answer;                  // sent instead if there is no memory for it
};

class Listener {
 public:
  using Serve = std::function<void(Connection&)>;  // returns when the connection is finished; must not throw

  // Binds and listens. Throws std::runtime_error saying what can't be bound and why.
  explicit Listener(ListenerOptions options);
  ~Listener();

  int port() const { return port_; }
  int connections() const;  // without those that were given up
  bool stopping() const { return stopping_.load(); }

  // Accepts until stop(); returns when the last connection is done. Once only.
  void run(const Serve& serve);
  // From any thread: accepts no more, and gives up connections that wait for their client.
  void stop();
  // Call after stop(). True once every connection is done; false if the deadline comes first.
  bool wait_until_done(Connection::Clock::time_point deadline);
  // Ends all connections in any state.
  void cut();

  static int extra_connections(int max_connections);
  static int health_connections(int max_connections);
  // Maximum number of open sockets.
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
  mutable std::mutex mutex_;  // guards clients_
  std::condition_variable closed_;
  std::list<Client> clients_;
};

}  // namespace selenograph::server
