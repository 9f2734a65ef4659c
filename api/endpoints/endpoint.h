// What every endpoint is given, and the endpoints. Each answers or throws; service.cpp turns what is thrown into
// problems.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "api/assets/assets.h"
#include "api/json/json_reader.h"
#include "api/message/memory_budget.h"
#include "api/message/message.h"
#include "api/message/problem.h"
#include "dem/support/cache.h"
#include "dem/support/error.h"
#include "engine/renderer.h"

namespace selenograph::api {

// Frames' metadata by content hash, of those whose header has no room for all of it: the latest, on a budget.
using LongMetadata = dem::Cache<std::string, std::string>;

// What one request takes of the service's budget.
class RequestMemory {
 public:
  explicit RequestMemory(MemoryBudget& budget) : budget_(budget) {}

  // From now on so many bytes, instead of what was taken before; waits a moment for its turn. Throws RequestError:
  // invalid_request at `pointer` when the budget never holds as much, busy when it doesn't now; Cancelled.
  void need(std::size_t bytes, std::string_view pointer, const StopToken& stop);

  // The claim, of an answer of so many bytes.
  MemoryBudget::Claim give_for(std::size_t answer_bytes);

 private:
  MemoryBudget& budget_;
  MemoryBudget::Claim claim_;
};

class Operation;

struct EndpointContext {
  const engine::Renderer& renderer;
  const Limits& limits;
  const Assets& assets;
  LongMetadata& long_metadata;
  RequestMemory& memory;
  const Request& request;
  StopToken stop;
  std::string_view segment;  // of the path, where the route has one
  // Texts that are made once.
  const std::string& openapi;
  const std::function<const std::string&()>& datasets;
};

// What a call answers, and what the API document says of it. endpoints/routes.cpp lists them.
Response answer_frames(const EndpointContext& context);
void describe_frames(Operation& operation);
Response answer_frame_metadata(const EndpointContext& context);
void describe_frame_metadata(Operation& operation);
Response answer_maps(const EndpointContext& context);
void describe_maps(Operation& operation);
Response answer_rays(const EndpointContext& context);
void describe_rays(Operation& operation);
Response answer_project(const EndpointContext& context);
void describe_project(Operation& operation);
Response answer_heights(const EndpointContext& context);
void describe_heights(Operation& operation);
Response answer_height(const EndpointContext& context);
void describe_height(Operation& operation);
Response answer_features(const EndpointContext& context);
void describe_features(Operation& operation);
Response answer_datasets(const EndpointContext& context);
void describe_datasets(Operation& operation);
Response answer_verify_round_trip(const EndpointContext& context);
void describe_verify_round_trip(Operation& operation);
Response answer_verify_mertis(const EndpointContext& context);
void describe_verify_mertis(Operation& operation);
Response answer_openapi(const EndpointContext& context);
void describe_openapi(Operation& operation);

// The body, which must be JSON within the limits. Throws RequestError.
Json json_body(const EndpointContext& context);

// Where a member that the engine can object to (ImpossibleRequest::member) stands in an endpoint's request.
struct MemberPointer {
  std::string_view member, pointer;
};

// Does `work`. The engine's refusal of a request whose every member is possible but that is not as a whole becomes an
// error of that member, or of `else_pointer` when it names none.
template <typename Work>
auto with_refusals_at(std::span<const MemberPointer> members, std::string_view else_pointer, Work&& work) {
  try {
    return work();
  } catch (const ImpossibleRequest& e) {
    for (const MemberPointer& m : members)
      if (m.member == e.member()) else_pointer = m.pointer;
    throw RequestError("invalid_request", e.what(), {{std::string(else_pointer), e.what()}});
  }
}

// While `e` is handled: rethrows it, too much work for a request's deadline; what is too much for any that this service
// grants, as an error of the member at `pointer`.
[[noreturn]] void refuse_work(const TooMuchWork& e, const std::string& pointer, const Limits& limits);

// 200 with application/json.
Response json_response(std::string text);
Response json_response(const nlohmann::ordered_json& json);

}  // namespace selenograph::api
