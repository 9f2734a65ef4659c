// HTTP/1.1 server. No other pair of files uses cpp-httplib.
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
  std::string host;     // anything but loopback needs a proxy in front
  int port;             // 0: any free port
  int max_connections;  // see Connections
  std::size_t max_body_bytes;
  std::shared_ptr<api::MemoryBudget> bodies;   // budget of bodies being received
  std::chrono::milliseconds idle_timeout;      // between requests of one connection
  std::chrono::milliseconds receive_timeout;   // for a request, from first to last byte
  SendPace send_pace;                          // for an answer
  std::function<int()> retry_after_s;          // for a client that gets no connection
  std::vector<std::string> trusted_proxies{};  // addresses whose token header is trusted, in addition to loopback
  std::vector<std::string> allowed_hosts{};    // in addition to host and the names of loopback: see AllowedHosts
};

// A completed request, for the log and the metrics. `path` is without query; empty when the request was unreadable.
struct AccessRecord {
  std::string method, path;
  std::string target;  // as sent, free of control characters
  int status = 0;
  std::size_t bytes = 0;  // bytes of the body handed to the system: not all if the client disconnected before
  double seconds = 0;     // from the complete request to the last byte handed to the system
  std::string error_code;
  std::string request_id;           // also in the response: X-Request-Id
  std::string token;                // name of the token that a trusted proxy accepted; empty: none
  std::string host;                 // address of the client or proxy
  std::size_t request_bytes = 0;    // size of its body
  double queued_s = 0, work_s = 0;  // time in the queue, and from there to the finished answer
  api::StageTimes stages{};         // as in Server-Timing
};

// One cpp-httplib server: the library accepts, parses, routes and writes. This class adds
//  - a thread per connection, and their limit: Connections;
//  - a deadline for each request and one for each answer: Connection;
//  - the checks of a head that the library leaves to its user: refusal_of(), AllowedHosts;
//  - problem+json from the api's table, in place of the library's empty error pages.
//
// If there is no memory even for a problem document, the client gets one that was prepared at the start.
class HttpServer {
 public:
  struct Impl;
  // Answers one request and sets `queued` to its time in the queue. HEAD is passed as "HEAD", and the body of its
  // answer is not sent. Peer::client of a request with a token through a trusted proxy names the token.
  using Handler = std::function<api::Response(const api::Request&, const Peer&, Connection::Clock::duration& queued)>;
  using Observer = std::function<void(const AccessRecord&)>;

  // Binds immediately; throws std::runtime_error on failure.
  HttpServer(const HttpOptions& options, Handler handler, Observer observer);
  ~HttpServer();

  int port() const;
  int connections() const;
  std::string url() const;  // "http://127.0.0.1:8080"

  // Accepts connections until stop(), and returns when all answers have been sent.
  void run();
  // The following may be called from any thread.
  void stop();
  // Call it after stop(). Returns true once all answers have been sent, and false at the deadline.
  bool wait_until_done(Connection::Clock::time_point deadline);
  // Ends all connections, which cancels their requests.
  void cut();

 private:
  std::unique_ptr<Impl> impl_;
};

// A small client for `serve --trial`.
struct ClientAnswer {
  int status = 0;  // 0: no response
  std::string content_type, body;
};
ClientAnswer http_request(const std::string& url, const std::string& method, const std::string& path,
                          const std::string& body = {}, const std::string& accept = "*/*");

}  // namespace selenograph::server
