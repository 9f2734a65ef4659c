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
#include "api/message/admission.h"
#include "api/message/json_text.h"
#include "api/message/message.h"
#include "api/message/problem.h"
#include "api/requests/parts/detail_json.h"
#include "dem/base/cache.h"
#include "dem/base/error.h"
#include "engine/renderer.h"

namespace selenograph::api {

// Cache of the metadata of recent frames, by content hash, for frames whose header could not hold all of it.
using LongMetadata = dem::Cache<std::string, std::string>;

// Admission of one request:
//
//   parse     nothing is claimed: bodies are bounded by their limit
//   work      claim_work(engine + answer)                  waits for memory and, for an expensive request, a slot
//   send      release_for_answer(bytes of the answer)      returns the slot, keeps the answer's memory
class RequestMemory {
 public:
  // Writes the time in the queue to `queued`.
  RequestMemory(Admission& admission, const std::string& client, bool needs_slot, Admission::Clock::duration& queued)
      : admission_(admission), client_(client), needs_slot_(needs_slot), queued_(queued) {}

  // Waits for `bytes` and for a slot; call it once, before the work. Throws RequestError: invalid_request at `pointer`
  // when the service never has as much memory, busy when the queue is full. Throws Cancelled.
  void claim_work(std::size_t bytes, std::string_view pointer, const StopToken& stop);

  // Returns the permit for an answer of `answer_bytes`, without its slot.
  Admission::Permit release_for_answer(std::size_t answer_bytes);

 private:
  Admission& admission_;
  const std::string& client_;
  const bool needs_slot_;
  Admission::Clock::duration& queued_;
  Admission::Permit permit_;
};

// Everything that an endpoint may use to answer one request.
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

// Parses the body, which must be JSON within the limits. Throws RequestError.
Json json_body(const EndpointContext& context);

// Returns the terrain's heights for poses above the ground, as /v1/heights answers them.
GroundHeights ground_heights(const EndpointContext& context);

// A body of JSON, or an .npz with arrays and the JSON as the text "request" (without it the JSON is an empty object).
struct Body {
  Json json;
  NpzArrays arrays;  // without "request"
};
// Parses the body. Throws RequestError.
Body parse_body(const EndpointContext& context);

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

// Throws the problem for too much work; call it while `e` is handled. Work within the longest deadline of this service
// rethrows `e`; more work is a fault of the member at `pointer`.
[[noreturn]] void refuse_work(const TooMuchWork& e, const std::string& pointer, const Limits& limits);

// Returns the media type among these that the request accepts, as choose_media_type() does.
std::string_view accepted(const EndpointContext& context, std::span<const Alternative> alternatives,
                          const std::function<bool(std::string_view)>& can_hold = {});

// Returns status 200 with the media type that was accepted. Throws Cancelled if the deadline has passed: a late answer
// is not sent.
Response negotiated(const EndpointContext& context, std::string_view media_type, std::string body);

// Appends the duration of indirect light and, where there is any, of its parts.
void add_indirect(const engine::StageTimes& times, StageTimes& stages);

// Return status 200 with application/json.
Response json_response(std::string text);
Response json_response(const nlohmann::ordered_json& json);

}  // namespace selenograph::api
