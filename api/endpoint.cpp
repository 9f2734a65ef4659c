#include "api/endpoint.h"

namespace selenograph::api {
namespace {

// "application/json", in any case, whatever parameters follow: JSON is UTF-8 by definition (RFC 8259, 8.1).
bool says_json(std::string content_type) {
  content_type = content_type.substr(0, content_type.find(';'));
  content_type.erase(content_type.find_last_not_of(" \t") + 1);
  for (char& c : content_type) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return content_type == "application/json";
}

}  // namespace

std::string header(const Request& request, const std::string& name) {
  std::string joined;
  const auto [first, last] = request.headers.equal_range(name);
  for (auto it = first; it != last; ++it) joined += (it == first ? "" : ", ") + it->second;
  return joined;
}

Json json_body(const EndpointContext& context) {
  const Request& request = context.request;
  if (!says_json(header(request, "content-type"))) {
    throw RequestError("unsupported_media_type", "the body must be application/json");
  }
  if (request.body.size() > context.limits.max_body_bytes) {
    throw RequestError("too_large", "the body has " + std::to_string(request.body.size()) + " bytes, at most " +
                                        std::to_string(context.limits.max_body_bytes) + " are taken");
  }
  return parse_json(request.body, context.limits.max_json_depth);
}

Response json_response(std::string text) {
  Response response;
  response.content_type = "application/json";
  response.body = std::move(text);
  return response;
}

Response json_response(const nlohmann::ordered_json& json) {
  return json_response(json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
}

}  // namespace selenograph::api
