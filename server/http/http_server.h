// HTTP/1.1 in and out. The only pair of files that knows cpp-httplib.
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
  std::string host;     // loopback: a proxy belongs in front of anything wider
  int port;             // 0: any free one
  int max_connections;  // who goes or is refused when it is reached: see Listener
  std::size_t max_body_bytes;
  std::shared_ptr<api::MemoryBudget> bodies;   // being received
  std::chrono::milliseconds idle_timeout;      // between requests of one connection
  std::chrono::milliseconds receive_timeout;   // for a whole request, first byte to last, however it dribbles
  SendPace send_pace;                          // for a whole answer
  std::function<int()> retry_after_s;          // for a client that there is no connection for
  std::vector<std::string> trusted_proxies{};  // beside loopback: they say by whose token a request came
  std::vector<std::string> allowed_hosts{};    // beside host and the names of loopback: see AllowedHosts
};

// One request answered, for the log and the metrics. `path` is without query; empty when the request could not be read.
struct AccessRecord {
  std::string method, path;
  std::string target;  // as sent, free of control characters
  int status = 0;
  std::size_t bytes = 0;  // of the body
  double seconds = 0;     // from the complete request to the last byte handed to the system
  std::string error_code;
  std::string request_id;                                   // in the answer, too: X-Request-Id
  std::string token;                                        // name of the token that a proxy let it in by; empty: none
  std::string host;                                         // at the other end: the client's or the proxy's address
  std::size_t request_bytes = 0;                            // of the body
  double queued_s = 0, work_s = 0;                          // waiting for a place; from there to the finished answer
  std::vector<std::pair<std::string, double>> stages_ms{};  // those of Server-Timing
};

// cpp-httplib parses requests, reads their bodies, hands them to handlers and writes the answers. It does so between a
// stream and a handler of ours, because its own server has
//  - an unbounded queue, few threads, idle clients that hold them: Listener's thread per connection, bounded, silent
//    ones go first;
//  - a timeout per read() and write(): RequestStream has one deadline for the whole request, Connection one for the
//    whole answer;
//  - lenient framing, ranges, compression, forms: RequestStream lets it see what check_head() and ChunkedBody leave;
//  - exception text in a header, empty error pages: problem+json from the api's table;
//  - select() and its 1024 descriptors, a backlog of 5, SO_REUSEPORT, no TCP_NODELAY: own sockets.
//
// Where memory is lacking even for a problem, the client gets one that was made when the service started.
class HttpServer {
 public:
  struct Impl;
  // Gets HEAD as "HEAD"; its body is not sent then. What it waited for a place goes to `queued`. Who comes through a
  // trusted proxy with a token is a client of his own: the token's name is his address.
  using Handler = std::function<api::Response(const api::Request&, const Peer&, Connection::Clock::duration& queued)>;
  using Observer = std::function<void(const AccessRecord&)>;

  // Binds at once; throws std::runtime_error when it can't.
  HttpServer(const HttpOptions& options, Handler handler, Observer observer);
  ~HttpServer();

  int port() const;
  int connections() const;
  std::string url() const;  // "http://127.0.0.1:8080"

  void run();  // until stop(); answers under way are finished
  // From any thread:
  void stop();
  bool wait_until_done(Connection::Clock::time_point deadline);  // true: all answers have been sent since stop()
  void cut();  // ends every connection, and raises `abandoned` of what is computed for them

 private:
  std::unique_ptr<Impl> impl_;
};

// A small client, for `serve --trial`. status 0: no answer came.
struct ClientAnswer {
  int status = 0;
  std::string content_type, body;
};
ClientAnswer http_request(const std::string& url, const std::string& method, const std::string& path,
                          const std::string& body = {}, const std::string& accept = "*/*");

}  // namespace selenograph::server
