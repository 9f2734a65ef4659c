// The service without HTTP: a request in, an answer out. server/ adds HTTP; `ask` uses it directly, so that both
// give the same bytes.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "api/message/admission.h"
#include "api/message/message.h"
#include "engine/renderer.h"
#include "engine/support/confined_reader.h"

namespace selenograph::api {

// Thread-safe: const functions may be called concurrently.
class Service {
 public:
  // `assets_folder` is the folder of Assets; empty: none. `reader` has the options for reading object meshes and
  // images. `admission` has the slots and the memory of requests and their responses; null: unbounded. A request that
  // could never fit is rejected, one that does not fit now waits for its turn.
  Service(std::shared_ptr<const engine::Renderer> renderer, Limits limits, const std::string& assets_folder = {},
          const engine::ReaderOptions& reader = {}, std::shared_ptr<Admission> admission = nullptr);
  ~Service();

  // Serves /v1/* and /openapi.json. Unknown paths give 404, known paths with a wrong method 405 with Allow. (Health and
  // metrics are served by server/.)
  Response handle(const Request& request) const;

  const Limits& limits() const;
  // Returns the memory of cached asset files, mostly meshes.
  std::size_t mesh_bytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::api
