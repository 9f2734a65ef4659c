// A request and its response, independent of HTTP.
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
  std::string path;                               // "/v1/frames", without the query
  std::multimap<std::string, std::string> query;  // decoded
  std::multimap<std::string, std::string> headers;
  std::string body;
  std::chrono::steady_clock::time_point received = std::chrono::steady_clock::now();
  const std::atomic<bool>* abandoned = nullptr;  // becomes true when the client has disconnected
};

struct Response {
  int status = 200;
  std::string content_type;
  std::vector<std::pair<std::string, std::string>> headers;  // without Content-Type and Content-Length
  std::string body;
  // Error code, also the label in metrics; empty on success.
  std::string error_code;
  // The answer's claim on the service's memory budget: kept until it is sent.
  std::shared_ptr<const MemoryBudget::Claim> memory;
};

// Values of all headers of this (lower-case) name, joined with commas; empty if there are none.
std::string header(const Request& request, const std::string& name);

// Time limit of a request: the service's own, or less if the client asks for it by Request-Timeout-Ms. Empty when that
// header is not a whole number of milliseconds above 0.
std::optional<std::chrono::milliseconds> time_allowed(const Request& request, const Limits& limits);

}  // namespace selenograph::api
