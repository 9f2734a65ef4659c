// HTTP/1.1 server. The only pair of files that uses cpp-httplib.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "api/message/message.h"
#include "server/http/connection.h"

namespace selenograph::server {

struct HttpOptions {
  std::string host;     // put a proxy in front of anything but loopback
  int port;             // 0: any free one
  int max_connections;  // see Connections
  std::size_t max_body_bytes;
  std::shared_ptr<api::MemoryBudget> bodies;   // budget of bodies being received
  std::chrono::milliseconds idle_timeout;      // between requests of one connection
  std::chrono::milliseconds receive_timeout;   // for a whole request, from first to last byte
  SendPace send_pace;                          // for a whole answer
  std::function<int()> retry_after_s;          // of a client that gets no connection
  std::vector<std::string> trusted_proxies{};  // beside loopback, whose token header is trusted
  std::vector<std::string> allowed_hosts{};    // beside host and the names of loopback: see AllowedHosts
};

// A completed request, for the log and the metrics. `path` is without query; empty when the request was unreadable.
struct AccessRecord {
  std::string method, path;
  std::string target;  // as sent, free of control characters
  int status = 0;
  std::size_t bytes = 0;  // of the body, handed to the system: fewer than it has where the client left before its end
  double seconds = 0;     // from the complete request to the last byte handed to the system
  std::string error_code;
  std::string request_id;           // also in the response: X-Request-Id
  std::string token;                // name of the token that a trusted proxy accepted; empty: none
  std::string host;                 // address of the client or proxy
  std::size_t request_bytes = 0;    // of the body
  double queued_s = 0, work_s = 0;  // in the queue; from there to the finished answer
  api::StageTimes stages{};         // those of Server-Timing
};

// One cpp-httplib server: the library accepts, parses, routes and writes. Of our own are
//  - a thread per connection, and their limit: Connections;
//  - a deadline for the whole request and one for the whole answer: Connection;
//  - the checks of a head that the library leaves to its user: refusal_of(), AllowedHosts;
//  - problem+json from the api's table, in place of empty error pages.
//
// If there is no memory even for a problem document, the client gets one that was made when the service started.
class HttpServer {
 public:
  struct Impl;
  // HEAD is passed as "HEAD"; its body is not sent. The time in the queue is returned in `queued`. Requests with a
  // token through a trusted proxy count as a client of their own.
  using Handler = std::function<api::Response(const api::Request&, const Peer&, Connection::Clock::duration& queued)>;
  using Observer = std::function<void(const AccessRecord&)>;

  // Binds immediately; throws std::runtime_error on failure.
  HttpServer(const HttpOptions& options, Handler handler, Observer observer);
  ~HttpServer();

  int port() const;
  int connections() const;
  std::string url() const;  // "http://127.0.0.1:8080"

  void run();  // until stop(); active answers are finished
  // From any thread:
  void stop();
  bool wait_until_done(Connection::Clock::time_point deadline);  // after stop(); true: all responses have been sent
  void cut();  // ends all connections, and sets `abandoned` of their requests

 private:
  std::unique_ptr<Impl> impl_;
};

// A small client for `serve --trial`. status 0: no response.
struct ClientAnswer {
  int status = 0;
  std::string content_type, body;
};
ClientAnswer http_request(const std::string& url, const std::string& method, const std::string& path,
                          const std::string& body = {}, const std::string& accept = "*/*");

}  // namespace selenograph::server
