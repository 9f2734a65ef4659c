// What every endpoint is given, and the endpoints. Each answers or throws; service.cpp turns what is thrown into
// problems.
#pragma once

#include <stdexcept>
#include <string>

#include "api/assets.h"
#include "api/json_reader.h"
#include "api/service.h"
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

// The engine's refusal of a request whose every member is possible but that is not as a whole. `pointer` is the member
// that it is about unless its text names another.
RequestError engine_refusal(const char* pointer, const std::invalid_argument& refusal);

// Does `work` and turns the engine's refusal into an error of the request.
template <typename Work>
auto refusing_at(const char* pointer, Work&& work) {
  try {
    return work();
  } catch (const std::invalid_argument& e) {
    throw engine_refusal(pointer, e);
  }
}

// 200 with application/json.
Response json_response(std::string text);
Response json_response(const nlohmann::ordered_json& json);

}  // namespace selenograph::api
