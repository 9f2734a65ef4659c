#include "api/service.h"

#include <algorithm>
#include <new>

#include "api/answers/datasets_answer.h"
#include "api/document/openapi.h"
#include "api/encode/negotiate.h"
#include "api/endpoints/routes.h"
#include "api/message/problem.h"
#include "dem/base/error.h"
#include "dem/base/once.h"

namespace selenograph::api {
namespace {

const Route& route_of(const Request& request) {
  bool known_path = false;
  for (const Route& route : routes()) {
    if (!segment_of(route, request.path)) continue;
    if (route.method == request.method) return route;
    known_path = true;
  }
  if (known_path) throw RequestError("method_not_allowed", "this path has another method; see Allow");
  throw RequestError("not_found", "no such path; GET /openapi.json lists those that exist");
}

}  // namespace

// A frame with tens of objects or a large kernel says some hundred kilobytes about itself.
constexpr std::size_t kLongMetadataBytes = std::size_t{8} << 20;

struct Service::Impl {
  Impl(const std::string& assets_folder, const engine::MeshReaderOptions& meshes) : assets(assets_folder, meshes) {}

  std::shared_ptr<const engine::Renderer> renderer;
  Limits limits;
  Assets assets;
  std::shared_ptr<MemoryBudget> memory;
  mutable LongMetadata long_metadata{kLongMetadataBytes};
  std::string openapi;
  // Made when first asked for: a catalogue of 64 800 tiles is 30 MB of text that most services never send.
  mutable dem::Once datasets_made;
  mutable std::string datasets_made_text;
  std::function<const std::string&()> datasets = [this]() -> const std::string& {
    datasets_made.run([&] { datasets_made_text = datasets_text(renderer->terrain().catalogue()); });
    return datasets_made_text;
  };

  // What the request needs of the budget while it is in work, and its answer until it is sent.
  Response answer(const Request& request) const {
    RequestMemory taken(*memory);
    Response response = dispatch(request, taken);
    // The answer may outlive the service, and the claim must not outlive its budget.
    struct Held {
      std::shared_ptr<MemoryBudget> budget;
      MemoryBudget::Claim claim;
    };
    const auto held = std::make_shared<const Held>(Held{memory, taken.give_for(response.body.capacity())});
    response.memory = {held, &held->claim};
    return response;
  }

  Response dispatch(const Request& request, RequestMemory& taken) const {
    const Route& route = route_of(request);
    if (!route.negotiates && !accepts(header(request, "accept"), "application/json"))
      throw RequestError("not_acceptable", "only application/json is available, and Accept excludes it");
    const auto allowed = time_allowed(request, limits);
    if (!allowed)
      throw RequestError("malformed_request", "Request-Timeout-Ms must be a whole number of milliseconds above 0");
    const auto in_work = route.admission ? renderer->pause_preparation() : nullptr;
    return route.answer({*renderer, limits, assets, long_metadata, taken, request,
                         StopToken(request.received + *allowed, request.abandoned), *segment_of(route, request.path),
                         openapi, datasets});
  }
};

Service::Service(std::shared_ptr<const engine::Renderer> renderer, Limits limits, const std::string& assets_folder,
                 const engine::MeshReaderOptions& meshes, std::shared_ptr<MemoryBudget> memory)
    : impl_(std::make_unique<Impl>(assets_folder, meshes)) {
  impl_->memory = memory ? std::move(memory) : std::make_shared<MemoryBudget>();
  impl_->renderer = std::move(renderer);
  impl_->limits = limits;
  impl_->openapi = openapi_document(limits).dump(2) + "\n";
}

Service::~Service() = default;

Response Service::handle(const Request& request) const noexcept {
  Response response = answer_or_problem(request, [&] { return impl_->answer(request); });
  if (response.error_code == "method_not_allowed")
    response.headers.emplace_back("Allow", allowed_methods(request.path));
  return response;
}

bool Service::needs_admission(const Request& request) {
  return std::ranges::any_of(routes(), [&](const Route& route) {
    return route.admission && route.method == request.method && segment_of(route, request.path);
  });
}

const Limits& Service::limits() const { return impl_->limits; }
std::size_t Service::mesh_bytes() const { return impl_->assets.mesh_bytes(); }

}  // namespace selenograph::api
