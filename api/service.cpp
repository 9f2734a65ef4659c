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

// Returns the route of a request. Throws "not_found" for an unknown path, "method_not_allowed" for a known path.
const Route& route_of(const Request& request) {
  bool path_exists = false;
  for (const Route& route : kRoutes) {
    if (!segment_of(route, request.path)) continue;
    if (route.method == request.method) return route;
    path_exists = true;
  }
  if (path_exists) throw RequestError("method_not_allowed", "this path has another method; see Allow");
  throw RequestError("not_found", "no such path; GET /openapi.json lists those that exist");
}

}  // namespace

// Capacity of the store of metadata too long for a header: a frame with tens of objects or a large kernel has some
// hundred kilobytes.
constexpr std::size_t kLongMetadataBytes = std::size_t{8} << 20;

struct Service::Impl {
  Impl(const std::string& assets_folder, const engine::ReaderOptions& reader) : assets(assets_folder, reader) {}

  std::shared_ptr<const engine::Renderer> renderer;
  Limits limits;
  Assets assets;
  std::shared_ptr<Admission> admission;
  mutable LongMetadata long_metadata{kLongMetadataBytes};
  std::string openapi;
  // Text of the catalogue, written at the first request for it: for 64 800 tiles it has 30 MB, and most services never
  // send it.
  mutable dem::Once datasets_made;
  mutable std::string datasets_made_text;
  std::function<const std::string&()> datasets = [this]() -> const std::string& {
    datasets_made.run([&] { datasets_made_text = datasets_text(renderer->terrain().catalogue()); });
    return datasets_made_text;
  };

  // Answers a request and measures its time in the queue. Its memory counts while it is processed; then the response's
  // body does.
  Response answer(const Request& request, Admission::Clock::duration& queued) const {
    const Route& route = route_of(request);
    RequestMemory request_memory(*admission, request.client, route.admission, queued);
    Response response = dispatch(route, request, request_memory);
    // The response shares ownership of the admission: it may outlive the service.
    struct AdmissionAndPermit {
      std::shared_ptr<Admission> admission;
      Admission::Permit permit;
    };
    response.memory = std::make_shared<const AdmissionAndPermit>(
        AdmissionAndPermit{admission, request_memory.release_for_answer(response.body.capacity())});
    return response;
  }

  // Checks the request's headers and calls its endpoint.
  Response dispatch(const Route& route, const Request& request, RequestMemory& request_memory) const {
    if (!route.negotiates && !accepts(header(request, "accept"), "application/json"))
      throw RequestError("not_acceptable", "only application/json is available, and Accept excludes it");
    const auto limit = time_limit(request, limits);
    if (!limit)
      throw RequestError("malformed_request", "Request-Timeout-Ms must be a whole number of milliseconds above 0");
    // Pause the preparation of expected scenes until the answer is complete.
    const auto pause = route.admission ? renderer->pause_preparation() : nullptr;
    return route.answer({*renderer, limits, assets, long_metadata, request_memory, request,
                         StopToken(request.received + *limit, request.abandoned), *segment_of(route, request.path),
                         openapi, datasets});
  }
};

Service::Service(std::shared_ptr<const engine::Renderer> renderer, Limits limits, const std::string& assets_folder,
                 const engine::ReaderOptions& reader, std::shared_ptr<Admission> admission)
    : impl_(std::make_unique<Impl>(assets_folder, reader)) {
  impl_->admission = admission ? std::move(admission) : std::make_shared<Admission>();
  impl_->renderer = std::move(renderer);
  impl_->limits = limits;
  impl_->openapi = openapi_document(limits).dump(2) + "\n";
}

Service::~Service() = default;

Response Service::handle(const Request& request) const {
  Admission::Clock::duration queued{};
  Response response = answer_or_problem(request, [&] { return impl_->answer(request, queued); });
  response.queued = queued;
  if (!response.stages.empty())
    response.stages.insert(response.stages.begin(),
                           {"queue", std::chrono::duration<double, std::milli>(queued).count()});
  if (response.error_code == "method_not_allowed")
    response.headers.emplace_back("Allow", allowed_methods(request.path));
  if (response.error_code == "busy" || response.error_code == "shutting_down")
    response.headers = {{"Retry-After", std::to_string(impl_->admission->retry_after_s())}};
  return response;
}

const Limits& Service::limits() const { return impl_->limits; }
std::size_t Service::mesh_bytes() const { return impl_->assets.mesh_bytes(); }

}  // namespace selenograph::api
