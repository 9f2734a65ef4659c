// A request and its answer, without the HTTP around them.
#pragma once

#include <atomic>
#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "api/message/limits.h"
#include "api/message/memory_budget.h"

namespace selenograph::api {

// Header names are lower case.
struct Request {
  std::string method;                             // "GET", "POST"
  std::string path;                               // "/v1/frames", without query
  std::multimap<std::string, std::string> query;  // decoded
  std::multimap<std::string, std::string> headers;
  std::string body;
  std::chrono::steady_clock::time_point received = std::chrono::steady_clock::now();
  const std::atomic<bool>* abandoned = nullptr;  // set true when the client has left
};

struct Response {
  int status = 200;
  std::string content_type;
  std::vector<std::pair<std::string, std::string>> headers;  // without Content-Type and Content-Length
  std::string body;
  // Code of the row of the error table, the metrics' label; empty on success.
  std::string error_code;
  // What the answer takes of the service's budget: to be kept until it is sent.
  std::shared_ptr<const MemoryBudget::Claim> memory;
};

// All headers of this (lower-case) name, joined with commas; empty without one.
std::string header(const Request& request, const std::string& name);

// How long a request may take: the service's own limit, or less if the client asks so by Request-Timeout-Ms. Empty when
// that header is no whole number of milliseconds above 0.
std::optional<std::chrono::milliseconds> time_allowed(const Request& request, const Limits& limits);

}  // namespace selenograph::api
