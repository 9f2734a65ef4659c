// The endpoints and their context. An endpoint returns an answer or throws; service.cpp converts exceptions to
// problems.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "api/assets/assets.h"
#include "api/encode/negotiate.h"
#include "api/encode/read_npz.h"
#include "api/json/json_reader.h"
#include "api/message/json_text.h"
#include "api/message/memory_budget.h"
#include "api/message/message.h"
#include "api/message/problem.h"
#include "dem/base/cache.h"
#include "dem/base/error.h"
#include "engine/renderer.h"

namespace selenograph::api {

// Metadata, by content hash, of recent frames whose header could not hold all of it; on a memory budget.
using LongMetadata = dem::Cache<std::string, std::string>;

// Memory of one request, taken from the service's budget.
class RequestMemory {
 public:
  explicit RequestMemory(MemoryBudget& budget) : budget_(budget) {}

  // Claims `bytes` for the request itself, its document and arrays, until give_for(). Errors as need().
  void hold(std::size_t bytes, const StopToken& stop);

  // Claims `bytes` for the work, instead of the previous amount; waits briefly for its turn. Throws RequestError:
  // invalid_request at `pointer` when the budget can never hold as much, busy when it cannot now; Cancelled.
  void need(std::size_t bytes, std::string_view pointer, const StopToken& stop);

  // Hands over the claim, resized for an answer of `answer_bytes`.
  MemoryBudget::Claim give_for(std::size_t answer_bytes);

 private:
  MemoryBudget& budget_;
  MemoryBudget::Claim claim_;
  std::size_t held_bytes_ = 0;
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
  std::string_view segment;  // variable segment of the path, if the route has one
  // Texts that are generated once.
  const std::string& openapi;
  const std::function<const std::string&()>& datasets;
};

// Each endpoint's answer and its description in the API document. endpoints/routes.cpp lists them.
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
Response answer_sky(const EndpointContext& context);
void describe_sky(Operation& operation);
Response answer_lidar(const EndpointContext& context);
void describe_lidar(Operation& operation);
Response answer_limb(const EndpointContext& context);
void describe_limb(Operation& operation);
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

// Parses the body, which must be JSON within the limits. Throws RequestError.
Json json_body(const EndpointContext& context);

// A body of JSON, or an .npz of arrays beside it: the JSON is the text "request" in there (without it an empty object).
struct Body {
  Json json;
  NpzArrays arrays;  // without "request"
};
// Throws RequestError.
Body body_of(const EndpointContext& context);

// JSON Pointer of a request member that the engine may reject (ImpossibleRequest::member).
struct MemberPointer {
  std::string_view member, pointer;
};

// Calls `work`. A rejection by the engine of a request whose members are valid one by one becomes an error of the
// member it names, or of `else_pointer`.
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

// Call while handling `e`: rethrows it if the work only exceeds the request's deadline; throws an error of the member
// at `pointer` if it exceeds any deadline that this service grants.
[[noreturn]] void refuse_work(const TooMuchWork& e, const std::string& pointer, const Limits& limits);

// The media type among these that the request accepts, as choose().
std::string_view accepted(const EndpointContext& context, std::span<const Alternative> alternatives,
                          const std::function<bool(std::string_view)>& holds = {});

// Status 200 with the media type that was accepted. An answer that is ready too late is none: throws Cancelled.
Response negotiated(const EndpointContext& context, std::string_view media_type, std::string body);

// Status 200 with application/json.
Response json_response(std::string text);
Response json_response(const nlohmann::ordered_json& json);

}  // namespace selenograph::api
