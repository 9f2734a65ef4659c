#include "api/problem.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

namespace selenograph::api {
namespace {

constexpr std::array<ErrorRow, 18> kTable{{
    {"malformed_request", 400, "Malformed request", "malformed_request",
     "The request line, a header or a query parameter can't be understood."},
    {"malformed_json", 400, "Malformed JSON", "malformed_json",
     "The body is not JSON text (RFC 8259), or is nested deeper than the service accepts."},
    {"not_found", 404, "Not found", "not_found", "There is nothing at this path."},
    {"method_not_allowed", 405, "Method not allowed", "method_not_allowed",
     "The path exists but not with this method; `Allow` lists those that it has."},
    {"not_acceptable", 406, "No such representation", "not_acceptable",
     "Nothing in `Accept` is a representation that this call has; `detail` lists those that there are."},
    {"request_timeout", 408, "Request too slow", "request_timeout", "The request did not arrive in time."},
    {"too_large", 413, "Body too large", "too_large", "The body is larger than the service accepts."},
    {"uri_too_long", 414, "URI too long", "uri_too_long", "The request target is longer than the service accepts."},
    {"unsupported_media_type", 415, "Unsupported media type", "unsupported_media_type",
     "The body must be `application/json`."},
    {"invalid_request", 422, "Invalid request", "invalid_request",
     "Well-formed JSON that asks for something impossible; `errors` points at each offending member."},
    {"headers_too_large", 431, "Headers too large", "headers_too_large",
     "The request's headers are larger than the service accepts."},
    {"client_gone", 499, "Client closed the connection", "client_gone",
     "The client left before its answer was ready. Seen in metrics only."},
    {"internal", 500, "Internal error", "internal", "A fault of the service itself."},
    {"terrain_data_error", 500, "Terrain data unusable", "terrain_data_error",
     "A DEM file that this call needs is missing, truncated or corrupt; `detail` names it. Asking again does not help: "
     "the operator must mend the file."},
    {"asset_error", 500, "Asset unusable", "asset_error",
     "A file of the assets folder that the request names can't be used; `detail` names file and line. The operator "
     "must "
     "mend it."},
    {"busy", 503, "Busy", "busy",
     "As many requests are in work and waiting as the service holds; `Retry-After` says when to come back."},
    {"shutting_down", 503, "Shutting down", "shutting_down",
     "The service finishes what it has and accepts nothing new."},
    {"deadline_exceeded", 504, "Deadline exceeded", "deadline_exceeded",
     "The answer was not ready within the service's deadline or the request's `Request-Timeout-Ms`."},
}};

}  // namespace

std::span<const ErrorRow> error_table() { return kTable; }

const ErrorRow& error_row(std::string_view code) {
  const auto by_code = [](std::string_view wanted) {
    return std::find_if(kTable.begin(), kTable.end(), [&](const ErrorRow& row) { return row.code == wanted; });
  };
  const auto found = by_code(code);
  return found != kTable.end() ? *found : *by_code("internal");
}

std::string problem_type(const ErrorRow& row) { return "urn:selenograph:problem:" + std::string(row.code); }

void Findings::add(std::string pointer, std::string detail) {
  if (!full()) kept_.push_back({std::move(pointer), std::move(detail)});
}

void Findings::throw_if_any() const {
  if (empty()) return;
  if (kept_.size() == 1) {
    const Finding& only = kept_.front();
    throw RequestError("invalid_request", (only.pointer.empty() ? "the body" : only.pointer) + ": " + only.detail,
                       kept_);
  }
  const std::string count = std::to_string(kept_.size()) + (full() ? " or more" : "");
  throw RequestError("invalid_request", count + " members are at fault; see errors", kept_);
}

RequestError::RequestError(std::string_view code, const std::string& detail, std::vector<Finding> findings)
    : std::runtime_error(detail), code_(code), findings_(std::move(findings)) {}

Response problem(const std::string& code, const std::string& detail, const std::vector<Finding>& findings) {
  const ErrorRow& row = error_row(code);
  nlohmann::ordered_json body{
      {"type", problem_type(row)}, {"title", row.title}, {"status", row.status}, {"detail", detail}};
  for (const Finding& finding : findings) {
    body["errors"].push_back({{"pointer", finding.pointer}, {"detail", finding.detail}});
  }
  Response response;
  response.status = row.status;
  response.content_type = "application/problem+json";
  // Details may quote what the client sent; `replace` because that need not be UTF-8.
  response.body = body.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
  response.error_code = row.code;
  return response;
}

Response problem(const std::string& error_code, const std::string& detail) { return problem(error_code, detail, {}); }

}  // namespace selenograph::api
