// HTTP/1.1 server: cpp-httplib with connections of its own.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "api/message/message.h"
#include "server/http/access.h"

namespace selenograph::server {

struct HttpOptions {
  std::string host;     // anything but loopback needs a proxy in front
  int port;             // 0: any free port
  int max_connections;  // beyond it, only `reserved_paths` are answered, the rest gets 503
  std::size_t max_body_bytes;
  std::chrono::milliseconds idle_time;         // between requests of one connection
  std::chrono::milliseconds receive_time;      // for a request, from first to last byte
  std::chrono::milliseconds answer_time;       // for the client to take its answer
  std::vector<std::string> reserved_paths{};   // answered although all connections are taken
  std::vector<std::string> trusted_proxies{};  // addresses whose token header is trusted, in addition to loopback
  std::vector<std::string> allowed_hosts{};    // in addition to host and the names of loopback: see refusal_by_host()
};

class HttpServer {
 public:
  using Clock = std::chrono::steady_clock;
  // Answers one request. HEAD is passed as "HEAD", and the body of its answer is not sent.
  using Handler = std::function<api::Response(const api::Request&)>;
  using Observer = std::function<void(const AccessRecord&)>;

  // Binds immediately; throws std::runtime_error on failure.
  static std::unique_ptr<HttpServer> make(const HttpOptions& options, Handler handler, Observer observer);
  virtual ~HttpServer() = default;

  virtual int port() const = 0;
  virtual int connections() const = 0;

  // Accepts connections until stop(), and returns when all have ended.
  virtual void run() = 0;
  // Returns true once all answers have been sent. At the deadline it ends the rest of the connections, which cancels
  // their requests, and returns false. May be called from any thread.
  virtual bool stop(Clock::time_point deadline) = 0;

 private:
  class Library;
};

}  // namespace selenograph::server
