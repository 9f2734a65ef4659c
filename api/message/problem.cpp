#include "api/message/problem.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <new>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "api/message/json_text.h"
#include "dem/base/error.h"

namespace selenograph::api {
namespace {

constexpr std::array<ErrorRow, 22> kTable{{
    {"malformed_request", 400, "Malformed request",
     "The request line, a header or a query parameter cannot be understood."},
    {"malformed_json", 400, "Malformed JSON",
     "The body is not JSON text (RFC 8259), or is nested deeper than the service accepts."},
    {"malformed_npz", 400, "Malformed NPZ",
     "The body is not an archive as `numpy.savez` writes it, of numbers and texts; `errors` names the array."},
    {"foreign_origin", 403, "Foreign origin",
     "The request comes from another site: its `Origin` is neither the request's own host and port nor allowed by the "
     "service's operator (`--allowed-host`)."},
    {"not_found", 404, "Not found", "There is nothing at this path."},
    {"method_not_allowed", 405, "Method not allowed",
     "The path does not support this method; `Allow` lists those it does."},
    {"not_acceptable", 406, "No such representation",
     "This call has no representation that `Accept` allows; `detail` lists those it has."},
    {"request_timeout", 408, "Request too slow", "The request did not arrive in time."},
    {"too_large", 413, "Body too large", "The body is larger than the service accepts."},
    {"uri_too_long", 414, "URI too long", "The request target is longer than the service accepts."},
    {"unsupported_media_type", 415, "Unsupported media type",
     "The body must be `application/json`, or, where the call takes arrays, `application/x-npz`."},
    {"misdirected_request", 421, "Unknown host",
     "The service is not known by the name in `Host`. Its operator can add it with `--allowed-host`; an address of the "
     "machine, and localhost there, need none."},
    {"invalid_request", 422, "Invalid request",
     "Well-formed JSON that asks for something impossible; `errors` points at each offending member."},
    {"client_gone", 499, "Client closed the connection",
     "The client left before its answer was ready. Seen in metrics only."},
    {"internal", 500, "Internal error", "A bug of the service itself."},
    {"terrain_data_error", 500, "Terrain data unusable",
     "A DEM file that this call needs is missing, truncated or corrupt; `detail` names it. A retry does not help: the "
     "operator must fix the file."},
    {"asset_error", 500, "Asset unusable",
     "A file of the assets folder that the request names cannot be used; `detail` names file and line. The operator "
     "must fix it."},
    {"busy", 503, "Busy",
     "The service is at capacity: no slot is free, and the queue is full; `Retry-After` says when to retry."},
    {"storage_unavailable", 503, "Storage unavailable",
     "A file could not be opened or read because of the system: no descriptors, no memory, a failing disk. Nothing is "
     "known to be wrong with the file; retry."},
    {kOutOfMemory, 503, "Out of memory",
     "There is not enough memory for this request in addition to the active ones; `Retry-After` says when to retry."},
    {"shutting_down", 503, "Shutting down", "The service finishes its requests and accepts no new ones."},
    {"deadline_exceeded", 504, "Deadline exceeded",
     "The answer was not ready within the service's deadline or the request's `Request-Timeout-Ms`."},
}};

bool client_has_left(const Request& request) {
  return request.abandoned && request.abandoned->load(std::memory_order_relaxed);
}

}  // namespace

std::span<const ErrorRow> error_table() { return kTable; }

const ErrorRow& error_row(std::string_view code) {
  const auto by_code = [](std::string_view row_code) {
    return std::find_if(kTable.begin(), kTable.end(), [&](const ErrorRow& row) { return row.code == row_code; });
  };
  const auto found = by_code(code);
  return found != kTable.end() ? *found : *by_code("internal");
}

std::string problem_type(const ErrorRow& row) { return "urn:selenograph:problem:" + std::string(row.code); }

void Findings::add(std::string pointer, std::string detail) {
  ++count_;
  if (!full()) entries_.push_back({std::move(pointer), std::move(detail)});
}

void Findings::throw_if_any() const {
  if (empty()) return;
  if (entries_.size() == 1) {
    const Finding& only = entries_.front();
    throw RequestError("invalid_request", (only.pointer.empty() ? "the body" : only.pointer) + ": " + only.detail,
                       entries_);
  }
  const std::string count = std::to_string(entries_.size()) + (full() ? " or more" : "");
  throw RequestError("invalid_request", count + " invalid members; see errors", entries_);
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
  response.body = json_line(body);
  response.error_code = row.code;
  if (row.status == 503) response.headers.emplace_back("Retry-After", "5");
  return response;
}

Response memory_problem() { return problem(std::string(kOutOfMemory), "not enough memory for this request"); }

// Returns the problem of a bug. Its text goes to the log only: it may contain anything.
Response unexpected(const Request& request, const std::exception& e) {
  spdlog::error("{} {}: {}", request.method, request.path, e.what());
  return problem("internal", "an unexpected error");
}

// Returns the problem of a fault that only the operator can remove, and logs it.
Response fault(const Request& request, std::string_view code, const std::exception& e) {
  spdlog::warn("{} {}: {}", request.method, request.path, e.what());
  return problem(std::string(code), e.what());
}

Response answer_or_problem(const Request& request, const std::function<Response()>& work) {
  try {
    return work();
  } catch (const RequestError& e) {
    if (error_row(e.code()).status == 500) return fault(request, e.code(), e);
    return problem(e.code(), e.what(), e.findings());
  } catch (const ImpossibleRequest& e) {
    return problem("invalid_request", e.what());
  } catch (const DataError& e) {
    return fault(request, "terrain_data_error", e);
  } catch (const SystemFault& e) {
    return fault(request, "storage_unavailable", e);
  } catch (const TooMuchWork& e) {
    return problem("deadline_exceeded", e.what());
  } catch (const Cancelled&) {
    if (client_has_left(request)) return problem("client_gone", "the client left");
    return problem(
        "deadline_exceeded",
        "not ready in time: ask for less, or allow more time (Request-Timeout-Ms, at most the service's --deadline-s)");
  } catch (const std::bad_alloc&) {
    return memory_problem();
  } catch (const std::length_error&) {  // a container asked for more than its max_size()
    return memory_problem();
  } catch (const std::system_error& e) {
    if (e.code() == std::errc::resource_unavailable_try_again || e.code() == std::errc::not_enough_memory)
      return memory_problem();  // a thread that could not be started
    return unexpected(request, e);
  } catch (const std::exception& e) {
    return unexpected(request, e);
  } catch (...) {
    return problem("internal", "an unexpected error");
  }
}

}  // namespace selenograph::api
