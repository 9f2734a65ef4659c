// The service without a socket: a request in, an answer out. server/ maps HTTP onto it; `render` uses it directly, so
// that both give the very same bytes.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "engine/renderer.h"

namespace selenograph::api {

struct Limits {
  std::size_t max_body_bytes = std::size_t{4} << 20;
  int max_json_depth = 16;
  int max_image_side = 8192;
  std::int64_t max_image_pixels = std::int64_t{16} << 20;
  int max_samples_per_pixel = 256;
  int max_rays = 100000;                              // rays, points of one request
  std::chrono::milliseconds default_deadline{60000};  // a client may ask for less: header `Request-Timeout-Ms`
};

// Header names are lower case.
struct Request {
  std::string method;                             // "GET", "POST"
  std::string path;                               // "/v1/frames", without query
  std::multimap<std::string, std::string> query;  // decoded
  std::multimap<std::string, std::string> headers;
  std::string body;
  std::chrono::steady_clock::time_point received = std::chrono::steady_clock::now();
  const std::atomic<bool>* abandoned = nullptr;  // set true when the client has left
};

struct Response {
  int status = 200;
  std::string content_type;
  std::vector<std::pair<std::string, std::string>> headers;  // without Content-Type and Content-Length
  std::string body;
  // The row of the error table that this is, for metrics; empty on success.
  std::string error_code;
};

// const means safe to call concurrently. `handle` never throws.
class Service {
 public:
  // `assets_folder`: see Assets; empty: none.
  Service(std::shared_ptr<const engine::Renderer> renderer, Limits limits, const std::string& assets_folder = {});
  ~Service();

  // /v1/*, /openapi.json. Unknown paths 404, known path with a wrong method 405 with Allow. (Health and metrics are
  // server/'s.)
  Response handle(const Request& request) const;

  // True for calls that cost render time and therefore pass admission (POST frames, rays, project, heights); GETs
  // don't.
  static bool needs_admission(const Request& request);

  const Limits& limits() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Request headers, the number of attempts and the like never leak into the answer: problem+json from the one error
// table. Used by server/ for what happens before a request reaches the service (413, 503, 408 ...).
Response problem(const std::string& error_code, const std::string& detail);

}  // namespace selenograph::api
