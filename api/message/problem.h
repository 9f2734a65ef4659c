// What can go wrong, in one table: error code, HTTP status, title. Nothing about errors lives anywhere else.
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

struct ErrorRow {
  std::string_view code;     // the end of the problem's `type`, and the label of the Prometheus counter
  int status;                // HTTP
  std::string_view title;    // the problem's `title`: the same words every time
  std::string_view meaning;  // one sentence for the API document
};

inline constexpr std::string_view kOutOfMemory = "out_of_memory";

std::span<const ErrorRow> error_table();

// The row of a code; an unknown code is a mistake of ours and answers "internal".
const ErrorRow& error_row(std::string_view code);

// `type` of a problem, e.g. "urn:selenograph:problem:invalid_request".
std::string problem_type(const ErrorRow& row);

// One fault in a request: a JSON Pointer (RFC 6901) to the offending member, and what is wrong with it.
struct Finding {
  std::string pointer;
  std::string detail;
};

// The faults found in one request, up to kMost: an answer stays readable, and a hostile request is not read to its end.
class Findings {
 public:
  static constexpr std::size_t kMost = 20;
  void add(std::string pointer, std::string detail);
  bool empty() const { return kept_.empty(); }
  bool full() const { return kept_.size() >= kMost; }
  std::size_t seen() const { return seen_; }  // kept or not
  const std::vector<Finding>& kept() const { return kept_; }
  // Throws RequestError("invalid_request") when there is one.
  void throw_if_any() const;

 private:
  std::vector<Finding> kept_;
  std::size_t seen_ = 0;
};

// A request that can't be served, and why. The only exception by which api/ refuses what a client sent.
class RequestError : public std::runtime_error {
 public:
  RequestError(std::string_view code, const std::string& detail, std::vector<Finding> findings = {});
  const std::string& code() const { return code_; }
  const std::vector<Finding>& findings() const { return findings_; }

 private:
  std::string code_;
  std::vector<Finding> findings_;
};

// application/problem+json (RFC 9457) with `errors` when there are findings. Never throws on what a client may have
// sent, bytes that are no UTF-8 included.
Response problem(const std::string& code, const std::string& detail, const std::vector<Finding>& findings = {});

// What `work` answers, or the problem that what it throws is. A RequestError is the row that it names, an
// ImpossibleRequest "invalid_request", a DataError "terrain_data_error", a SystemFault "storage_unavailable", Cancelled
// "client_gone" or "deadline_exceeded", a lack of memory or threads kOutOfMemory. All else, a library's
// std::invalid_argument among it, is "internal": what it says is logged for the operator and not sent.
Response answer_or_problem(const Request& request, const std::function<Response()>& work) noexcept;

// Status and error code alone: where there is no memory for a problem, server/ sends one that it made beforehand.
Response out_of_memory() noexcept;

}  // namespace selenograph::api
