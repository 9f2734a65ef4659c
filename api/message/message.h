// A request and its response, without a socket. Paths, headers and statuses are those of HTTP.
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

namespace selenograph::api {

// A request. Header names are lower case.
struct Request {
  std::string method;                             // "GET", "POST"
  std::string path;                               // "/v1/frames", without the query
  std::multimap<std::string, std::string> query;  // decoded
  std::multimap<std::string, std::string> headers;
  std::string body;
  std::string peer;    // numeric address of the client, or of its proxy
  std::string client;  // identity in the queue: `peer`, or "token NAME" as named by a proxy
  std::chrono::steady_clock::time_point received = std::chrono::steady_clock::now();
  const std::atomic<bool>* abandoned = nullptr;  // becomes true when the client has disconnected
};

// Duration of a stage of the work on a request, as in the header Server-Timing.
struct StageTime {
  std::string name;
  double ms = 0;
  bool operator==(const StageTime&) const = default;
};
using StageTimes = std::vector<StageTime>;

// An answer, or the problem document of a failure.
struct Response {
  int status = 200;
  std::string content_type;
  std::vector<std::pair<std::string, std::string>> headers;  // without Content-Type, Content-Length and Server-Timing
  std::string body;
  // Error code, also the label in metrics; empty on success.
  std::string error_code;
  StageTimes stages{};  // in the order of the header Server-Timing; empty: the answer has no such header
  std::chrono::steady_clock::duration queued{};  // time in the queue
  std::shared_ptr<const void> memory;            // keeps the body's bytes claimed (Admission) until the answer is sent
};

// Returns the values of all headers of this (lower-case) name, joined with commas; empty if there are none.
std::string header(const Request& request, const std::string& name);

// Returns the time limit of a request: the service's own, or less if the client asks for it by Request-Timeout-Ms;
// empty if that header is not a whole number of milliseconds above 0.
std::optional<std::chrono::milliseconds> time_limit(const Request& request, const Limits& limits);

}  // namespace selenograph::api
