#include "api/endpoints/endpoint.h"

#include <fmt/format.h>

#include <algorithm>

#include "dem/base/names.h"
#include "engine/cache/budget.h"

namespace selenograph::api {
namespace {

// Returns true if a Content-Type header names the media type. It ignores case and parameters: JSON is UTF-8 by
// definition (RFC 8259, 8.1).
bool has_media_type(std::string_view media_type, std::string content_type) {
  content_type = content_type.substr(0, content_type.find(';'));
  content_type.erase(content_type.find_last_not_of(" \t") + 1);
  return dem::same_text(content_type, media_type);
}

}  // namespace

void add_indirect(const engine::StageTimes& times, StageTimes& stages) {
  stages.push_back({"indirect", times.indirect_ms});
  if (!(times.indirect_ms > 0)) return;
  const engine::LightTimes& light = times.light;
  stages.insert(stages.end(), {{"relief", light.relief_ms},
                               {"views", light.views_ms},
                               {"sunlit", light.sunlit_ms},
                               {"bounces", light.bounces_ms},
                               {"gather", light.gather_ms}});
}

void refuse_work(const TooMuchWork& e, const std::string& pointer, const Limits& limits) {
  // Rethrow `e`, which becomes "deadline_exceeded", if the request can succeed with a longer Request-Timeout-Ms.
  const auto longest_ms = static_cast<double>(limits.default_deadline.count());
  if (engine::SpeedGauge::in_reach(e.predicted_ms(), longest_ms)) throw;
  const std::string detail = fmt::format("{}; this service allows {:g} s", e.what(), longest_ms / 1e3);
  throw RequestError("invalid_request", detail, {{pointer, detail}});
}

Json json_body(const EndpointContext& context) {
  const Request& request = context.request;
  if (!has_media_type("application/json", header(request, "content-type"))) {
    throw RequestError("unsupported_media_type", "the body must be application/json");
  }
  if (request.body.size() > context.limits.max_body_bytes) {
    throw RequestError("too_large", "the body has " + std::to_string(request.body.size()) + " bytes, at most " +
                                        std::to_string(context.limits.max_body_bytes) + " are taken");
  }
  return parse_json(request.body);
}

GroundHeights ground_heights(const EndpointContext& context) {
  return [&context](const std::shared_ptr<const dem::Detail>& detail, double lat_deg, double lon_deg) {
    return context.renderer.terrain_with(detail)->height(lat_deg, lon_deg, context.stop).height_m;
  };
}

Body parse_body(const EndpointContext& context) {
  const Request& request = context.request;
  if (!has_media_type("application/x-npz", header(request, "content-type"))) {
    if (!has_media_type("application/json", header(request, "content-type")))
      throw RequestError("unsupported_media_type", "the body must be application/json or application/x-npz");
    return {json_body(context), {}};
  }
  // The text has the limit of a JSON body. All unpacked arrays together may have four times as many bytes.
  const std::size_t max_text_bytes = context.limits.max_body_bytes;
  Body body{Json::object(), read_npz(request.body, 4 * max_text_bytes, context.stop)};
  if (const auto text = body.arrays.find("request"); text != body.arrays.end()) {
    if (!text->second.text)
      throw RequestError("malformed_npz", "array \"request\" is not a text", {{"/request", "must be a JSON text"}});
    if (text->second.text->size() > max_text_bytes)
      throw RequestError("too_large", fmt::format("the text \"request\" has {} bytes, at most {} are taken",
                                                  text->second.text->size(), max_text_bytes));
    body.json = parse_json(*text->second.text);
    body.arrays.erase(text);
  }
  return body;
}

void RequestMemory::claim_work(std::size_t bytes, std::string_view pointer, const StopToken& stop) {
  if (bytes > admission_.limits().max_bytes) {
    const std::string detail =
        fmt::format("takes {} MB of memory, the service has {} MB for all requests (--memory-mb)", bytes >> 20,
                    admission_.limits().max_bytes >> 20);
    throw RequestError("invalid_request", "the request " + detail, {{std::string(pointer), detail}});
  }
  // Measures the wait however it ends.
  struct Wait {
    Admission::Clock::duration& measured;
    Admission::Clock::time_point start = Admission::Clock::now();
    ~Wait() { measured = Admission::Clock::now() - start; }
  } const wait{queued_};
  permit_ = needs_slot_ ? admission_.enter(client_, bytes, stop) : admission_.claim(bytes);
}

Admission::Permit RequestMemory::release_for_answer(std::size_t answer_bytes) {
  if (!permit_) permit_ = admission_.claim(answer_bytes);
  permit_.finish(answer_bytes);
  return std::move(permit_);
}

std::string_view accepted(const EndpointContext& context, std::span<const Alternative> alternatives,
                          const std::function<bool(std::string_view)>& can_hold) {
  return choose_media_type(header(context.request, "accept"), alternatives, can_hold);
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
