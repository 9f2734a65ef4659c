#include "api/endpoints/endpoint.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>

#include "dem/files/names.h"
#include "engine/budget.h"

namespace selenograph::api {
namespace {

// How long a request that is in work waits for others' memory: then it makes room for one that needs less.
constexpr auto kPatience = std::chrono::seconds(2);

// A document takes up to so many times its text: numbers of one digit are 16 bytes of a value, names 32 and a node.
constexpr std::size_t kDocumentBytesPerByte = 24;

// "application/json" or another type, in any case, whatever parameters follow: JSON is UTF-8 by definition (RFC 8259,
// 8.1).
bool says(std::string_view media_type, std::string content_type) {
  content_type = content_type.substr(0, content_type.find(';'));
  content_type.erase(content_type.find_last_not_of(" \t") + 1);
  return dem::same_text(content_type, media_type);
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
  context.memory.need(kDocumentBytesPerByte * request.body.size(), "", context.stop);
  return parse_json(request.body, context.limits.max_json_depth);
}

Body body_of(const EndpointContext& context) {
  const Request& request = context.request;
  if (!says("application/x-npz", header(request, "content-type"))) {
    if (!says("application/json", header(request, "content-type")))
      throw RequestError("unsupported_media_type", "the body must be application/json or application/x-npz");
    return {json_body(context), {}};
  }
  // Packed, they may be larger than the body; of small numbers eight times as large once more.
  const std::size_t most = 4 * context.limits.max_body_bytes;
  context.memory.need(request.body.size() + 9 * std::min(most, std::max(request.body.size(), most / 4)), "",
                      context.stop);
  Body body{Json::object(), read_npz(request.body, most, context.stop)};
  if (const auto text = body.arrays.find("request"); text != body.arrays.end()) {
    if (!text->second.text)
      throw RequestError("malformed_npz", "array \"request\" is not a text", {{"/request", "must be a JSON text"}});
    body.json = parse_json(*text->second.text, context.limits.max_json_depth);
    body.arrays.erase(text);
  }
  return body;
}

void RequestMemory::need(std::size_t bytes, std::string_view pointer, const StopToken& stop) {
  claim_ = {};  // whoever waits holds nothing
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
