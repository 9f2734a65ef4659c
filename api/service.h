// The service without a socket: a request in, an answer out. server/ maps HTTP onto it; `render` uses it directly, so
// that both give the very same bytes.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "api/message/message.h"
#include "engine/renderer.h"
#include "engine/visibility/meshes/mesh_reader.h"

namespace selenograph::api {

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

}  // namespace selenograph::api
