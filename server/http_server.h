// HTTP/1.1 in and out. The only pair of files that knows cpp-httplib.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "api/service.h"

namespace selenograph::server {

struct HttpOptions {
  std::string host;     // loopback: a proxy belongs in front of anything wider
  int port;             // 0: any free one
  int max_connections;  // when reached, the connection that has waited longest for its client goes
  std::size_t max_body_bytes;
  std::chrono::milliseconds idle_timeout;     // between requests of one connection
  std::chrono::milliseconds receive_timeout;  // for a whole request, first byte to last, however it dribbles
};

// One request answered, for the log and the metrics. `path` is without query; empty when the request could not be read.
struct AccessRecord {
  std::string method, path;
  std::string target;  // as sent, free of control characters
  int status = 0;
  std::size_t bytes = 0;  // of the body
  double seconds = 0;     // from the complete head to the last byte handed to the system
  std::string error_code;
};

// What httplib's own server would do wrong, and what happens here instead:
//  - unbounded queue, few threads, idle clients holding them: Listener's thread per connection, bounded, silent ones go
//  first;
//  - a timeout per read(): one deadline for the whole request;
//  - unlimited bodies without Content-Length: counted while they come, raw and decoded;
//  - ranges, compression, lenient framing: check_head();
//  - exception text in a header, empty error pages: problem+json from the api's table;
//  - select() and its 1024 descriptors, a backlog of 5, SO_REUSEPORT, no TCP_NODELAY: own sockets.
// What remains httplib's: request line, target and header parsing, chunked decoding, and writing status and headers.
class HttpServer {
 public:
  using Handler = std::function<api::Response(const api::Request&)>;  // gets HEAD as "HEAD"; its body is not sent then
  using Observer = std::function<void(const AccessRecord&)>;

  // Binds at once; throws std::runtime_error when it can't.
  HttpServer(const HttpOptions& options, Handler handler, Observer observer);
  ~HttpServer();

  int port() const;
  int connections() const;
  std::string url() const;  // "http://127.0.0.1:8080"

  void run();   // until stop(); answers under way are finished
  void stop();  // from any thread

 private:
  struct Impl;
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
