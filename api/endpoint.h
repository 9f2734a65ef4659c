// What every endpoint is given, and the endpoints. Each answers or throws; service.cpp turns what is thrown into
// problems.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "api/assets.h"
#include "api/json_reader.h"
#include "api/problem.h"
#include "api/service.h"
#include "dem/error.h"
#include "engine/renderer.h"

namespace selenograph::api {

struct EndpointContext {
  const engine::Renderer& renderer;
  const Limits& limits;
  const Assets& assets;
  const Request& request;
  StopToken stop;
};

Response answer_frames(const EndpointContext& context);
Response answer_rays(const EndpointContext& context);
Response answer_project(const EndpointContext& context);
Response answer_heights(const EndpointContext& context);
Response answer_height(const EndpointContext& context);
Response answer_verify_round_trip(const EndpointContext& context);
Response answer_verify_mertis(const EndpointContext& context);

// The catalogue as JSON text: tiles, footprints, resolution, datum, gaps, and files that could not be used.
std::string datasets_text(const dem::Catalogue& catalogue);

// All headers of this (lower-case) name, joined with commas; empty without one.
std::string header(const Request& request, const std::string& name);

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

// 200 with application/json.
Response json_response(std::string text);
Response json_response(const nlohmann::ordered_json& json);

}  // namespace selenograph::api
