// The table of errors: code, HTTP status, title. Nothing about errors is defined anywhere else.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "api/message/message.h"

namespace selenograph::api {

// A row of the table of errors.
struct ErrorRow {
  std::string_view code;     // last part of the problem's `type`, and label of the Prometheus counter
  int status;                // HTTP status
  std::string_view title;    // the problem's `title`, constant
  std::string_view meaning;  // one sentence for the API document
};

inline constexpr std::string_view kOutOfMemory = "out_of_memory";

std::span<const ErrorRow> error_table();

// Returns the row of a code; an unknown code is a bug and gives "internal".
const ErrorRow& error_row(std::string_view code);

// Returns the `type` of a problem document, e.g. "urn:selenograph:problem:invalid_request".
std::string problem_type(const ErrorRow& row);

// An error in a request: a JSON Pointer (RFC 6901) to the offending member, and a description.
struct Finding {
  std::string pointer;
  std::string detail;
};

// The faults found in one request. At most kMaxEntries are stored: a response stays readable, and a hostile request is
// not read to its end.
class Findings {
 public:
  static constexpr std::size_t kMaxEntries = 20;
  void add(std::string pointer, std::string detail);
  bool empty() const { return entries_.empty(); }
  bool full() const { return entries_.size() >= kMaxEntries; }
  std::size_t count() const { return count_; }  // including faults that are not stored
  const std::vector<Finding>& entries() const { return entries_; }
  // Throws RequestError("invalid_request") if there are any.
  void throw_if_any() const;

 private:
  std::vector<Finding> entries_;
  std::size_t count_ = 0;
};

// A request that cannot be served, and the reason. The only exception with which api/ rejects client input.
class RequestError : public std::runtime_error {
 public:
  RequestError(std::string_view code, const std::string& detail, std::vector<Finding> findings = {});
  const std::string& code() const { return code_; }
  const std::vector<Finding>& findings() const { return findings_; }

 private:
  std::string code_;
  std::vector<Finding> findings_;
};

// Returns application/problem+json (RFC 9457) with `errors` when there are findings, and Retry-After with status 503.
// The texts may contain any client input, including bytes that are not UTF-8.
Response problem(const std::string& code, const std::string& detail, const std::vector<Finding>& findings = {});

// Returns the result of `work`, or the problem for its exception. A RequestError gives the row that it names, an
// ImpossibleRequest "invalid_request", a DataError "terrain_data_error", a SystemFault "storage_unavailable",
// TooMuchWork "deadline_exceeded", Cancelled "client_gone" or "deadline_exceeded", a lack of memory or threads
// kOutOfMemory. Anything else, including a library's std::invalid_argument, is "internal": its text is logged for the
// operator and not sent. Throws std::bad_alloc if memory is too short for the problem, too.
Response answer_or_problem(const Request& request, const std::function<Response()>& work);

}  // namespace selenograph::api
