// The service without a socket: a request in, an answer out. server/ maps HTTP onto it; `render` uses it directly, so
// that both give the very same bytes.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "api/message/memory_budget.h"
#include "engine/renderer.h"
#include "engine/visibility/meshes/mesh_reader.h"

namespace selenograph::api {

struct Limits {
  std::size_t max_body_bytes = std::size_t{4} << 20;
  int max_json_depth = 16;
  int max_image_side = 8192;
  std::int64_t max_image_pixels = std::int64_t{16} << 20;
  std::int64_t max_map_pixels = std::int64_t{16} << 20;
  int max_samples_per_pixel = 256;
  int max_rays = 100000;                              // rays, points of one request; craters of one answer
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
  // Code of the row of the error table, the metrics' label; empty on success.
  std::string error_code;
  // What the answer takes of the service's budget: to be kept until it is sent.
  std::shared_ptr<const MemoryBudget::Claim> memory;
};

// How long a request may take: the service's own limit, or less if the client asks so by Request-Timeout-Ms. Empty when
// that header is no whole number of milliseconds above 0.
std::optional<std::chrono::milliseconds> time_allowed(const Request& request, const Limits& limits);

// const means safe to call concurrently.
class Service {
 public:
  // `assets_folder`: see Assets; empty: none. `meshes`: how those of its objects are read. `memory`: of requests in
  // work and their answers; null: unbounded. A request that could never fit is refused, one that doesn't fit now waits
  // a moment for its turn.
  Service(std::shared_ptr<const engine::Renderer> renderer, Limits limits, const std::string& assets_folder = {},
          const engine::MeshReaderOptions& meshes = {}, std::shared_ptr<MemoryBudget> memory = nullptr);
  ~Service();

  // /v1/*, /openapi.json. Unknown paths 404, known path with a wrong method 405 with Allow. (Health and metrics are
  // server/'s.)
  Response handle(const Request& request) const noexcept;

  // True for requests that cost time and therefore pass admission control: all but the catalogue and the API document.
  static bool needs_admission(const Request& request);

  const Limits& limits() const;
  // Of the meshes that are kept between requests.
  std::size_t mesh_bytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// An application/problem+json answer from the error table. server/ uses it for what happens before a request reaches
// the service (408, 413, 503 ...).
Response problem(const std::string& error_code, const std::string& detail);

}  // namespace selenograph::api
