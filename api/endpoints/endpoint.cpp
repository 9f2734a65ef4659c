#include "api/endpoints/endpoint.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>

#include "api/json/document_bytes.h"
#include "dem/base/names.h"
#include "engine/cache/budget.h"

namespace selenograph::api {
namespace {

// How long a request that is in work waits for others' memory: then it makes room for one that needs less.
constexpr auto kPatience = std::chrono::seconds(2);

// "application/json" or another type, in any case, whatever parameters follow: JSON is UTF-8 by definition (RFC 8259,
// 8.1).
bool says(std::string_view media_type, std::string content_type) {
  content_type = content_type.substr(0, content_type.find(';'));
  content_type.erase(content_type.find_last_not_of(" \t") + 1);
  return dem::same_text(content_type, media_type);
}

Json parsed(std::string_view text, const EndpointContext& context) {
  context.memory.hold(document_bytes(text), context.stop);
  return parse_json(text, context.limits.max_json_depth);
}

}  // namespace

void refuse_work(const TooMuchWork& e, const std::string& pointer, const Limits& limits) {
  const auto longest_ms = static_cast<double>(limits.default_deadline.count());
  if (engine::SpeedGauge::in_reach(e.predicted_ms(), longest_ms)) throw;
  const std::string detail = fmt::format("{}; this service allows {:g} s", e.what(), longest_ms / 1e3);
  throw RequestError("invalid_request", detail, {{pointer, detail}});
}

Json json_body(const EndpointContext& context) {
  const Request& request = context.request;
  if (!says("application/json", header(request, "content-type"))) {
    throw RequestError("unsupported_media_type", "the body must be application/json");
  }
  if (request.body.size() > context.limits.max_body_bytes) {
    throw RequestError("too_large", "the body has " + std::to_string(request.body.size()) + " bytes, at most " +
                                        std::to_string(context.limits.max_body_bytes) + " are taken");
  }
  return parsed(request.body, context);
}

Body body_of(const EndpointContext& context) {
  const Request& request = context.request;
  if (!says("application/x-npz", header(request, "content-type"))) {
    if (!says("application/json", header(request, "content-type")))
      throw RequestError("unsupported_media_type", "the body must be application/json or application/x-npz");
    return {json_body(context), {}};
  }
  const std::size_t max_text_bytes = context.limits.max_body_bytes;
  const auto hold = [&](std::size_t bytes) { context.memory.hold(bytes, context.stop); };
  Body body{Json::object(), read_npz(request.body, 4 * max_text_bytes, hold, context.stop)};
  if (const auto text = body.arrays.find("request"); text != body.arrays.end()) {
    if (!text->second.text)
      throw RequestError("malformed_npz", "array \"request\" is not a text", {{"/request", "must be a JSON text"}});
    if (text->second.text->size() > max_text_bytes)
      throw RequestError("too_large", fmt::format("the text \"request\" has {} bytes, at most {} are taken",
                                                  text->second.text->size(), max_text_bytes));
    body.json = parsed(*text->second.text, context);
    body.arrays.erase(text);
  }
  return body;
}

void RequestMemory::hold(std::size_t bytes, const StopToken& stop) {
  held_bytes_ += bytes;
  need(0, "", stop);
}

void RequestMemory::need(std::size_t work_bytes, std::string_view pointer, const StopToken& stop) {
  const std::size_t bytes = held_bytes_ + work_bytes;
  if (claim_.bytes() > 0 && claim_.try_resize(bytes)) return;
  claim_ = {};  // two requests that each hold memory and wait for more would wait for each other
  if (!budget_.fits(bytes)) {
    const std::string detail =
        fmt::format("takes {} MB of memory, the service has {} MB for all requests (--memory-mb)", bytes >> 20,
                    budget_.capacity() >> 20);
    throw RequestError("invalid_request", "the request " + detail, {{std::string(pointer), detail}});
  }
  auto claim = budget_.claim(bytes, StopToken::Clock::now() + kPatience, stop);
  if (!claim) throw RequestError("busy", "the memory that this request takes is in use by others");
  claim_ = std::move(*claim);
}

MemoryBudget::Claim RequestMemory::give_for(std::size_t answer_bytes) {
  held_bytes_ = 0;
  if (claim_.bytes() == 0) need(answer_bytes, "", {});
  claim_.resize(answer_bytes);
  return std::move(claim_);
}

std::string_view accepted(const EndpointContext& context, std::span<const Alternative> alternatives,
                          const std::function<bool(std::string_view)>& holds) {
  return choose(header(context.request, "accept"), alternatives, holds);
}

Response negotiated(const EndpointContext& context, std::string_view media_type, std::string body) {
  context.stop.check();
  Response response;
  response.content_type = media_type;
  response.body = std::move(body);
  response.headers.emplace_back("Vary", "Accept");
  return response;
}

Response json_response(std::string text) {
  Response response;
  response.content_type = "application/json";
  response.body = std::move(text);
  return response;
}

Response json_response(const nlohmann::ordered_json& json) { return json_response(json_line(json)); }

}  // namespace selenograph::api
