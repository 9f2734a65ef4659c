// HTTP/1.1 server: cpp-httplib with connections of its own. Only Connection uses cpp-httplib, too.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <list>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "api/message/message.h"
#include "server/http/allowed_hosts.h"
#include "server/http/caller.h"
#include "server/http/connection.h"

namespace selenograph::server {

struct HttpOptions {
  std::string host;     // anything but loopback needs a proxy in front
  int port;             // 0: any free port
  int max_connections;  // beyond it, only `reserved_paths` are answered, the rest gets 503
  std::size_t max_body_bytes;
  std::chrono::milliseconds idle_time;         // between requests of one connection
  std::chrono::milliseconds receive_time;      // for a request, from first to last byte
  std::chrono::milliseconds answer_time;       // for the client to take its answer
  std::function<int()> retry_after_s;          // for a client that gets no connection
  std::vector<std::string> reserved_paths{};   // answered although all connections are taken
  std::vector<std::string> trusted_proxies{};  // addresses whose token header is trusted, in addition to loopback
  std::vector<std::string> allowed_hosts{};    // in addition to host and the names of loopback: see AllowedHosts
};

// One cpp-httplib server: the library accepts, parses, routes and writes, each connection on a thread of its pool. This
// class adds deadlines and clients that leave (Connection), access by Host and Origin (AllowedHosts), connections in
// reserve, and problem+json from the api's table.
class HttpServer : private httplib::Server {
 public:
  using Clock = Connection::Clock;
  // Answers one request. HEAD is passed as "HEAD", and the body of its answer is not sent.
  using Handler = std::function<api::Response(const api::Request&)>;
  using Observer = std::function<void(const AccessRecord&)>;

  // Binds immediately; throws std::runtime_error on failure.
  HttpServer(const HttpOptions& options, Handler handler, Observer observer);
  ~HttpServer() override;

  int port() const { return port_; }
  int connections() const;
  std::string url() const;  // "http://127.0.0.1:8080"

  // Accepts connections until stop(), and returns when all have ended.
  void run();
  // Returns true once all answers have been sent. At the deadline it ends the rest of the connections, which cancels
  // their requests, and returns false. May be called from any thread.
  bool stop(Clock::time_point deadline);

 private:
  struct Exchange;
  struct ExchangeCarrier;
  static Exchange* exchange_of(const httplib::Request& request);
  void set_handlers();
  void bind(int at_port);
  bool process_and_close_socket(socket_t socket) override;
  bool add(Connection& connection);
  long end_idle();
  void detect_disconnected_clients();
  bool serve_request(Connection& connection, bool is_reserved);
  void take_head(Exchange& exchange, httplib::Request& request) const;
  std::optional<Refusal> refusal_of(const Exchange& exchange, const httplib::Request& request) const;
  void receive_body(Exchange& exchange, const httplib::ContentReader& read_body) const;
  void answer(Exchange& exchange, const httplib::Request& request, httplib::Response& out) const;
  void hand_over(Exchange& exchange, api::Response&& answer, httplib::Response& out) const;
  api::Response work(Exchange& exchange) const;
  api::Response refuse(const Refusal& why) const;

  const HttpOptions options_;
  const AllowedHosts hosts_;
  const Handler handler_;
  const Observer observer_;
  int port_;
  std::atomic<bool> stopping_{false};
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::list<Connection*> open_;
  bool ending_ = false;
  std::thread detection_;
};

}  // namespace selenograph::server
