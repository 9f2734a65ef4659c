// A request's client: its identity, its record for log and metrics, and access control by Host and Origin.
//
// A browser lets a page read the responses of its own origin. A page of evil.example has the service's origin once its
// owner resolves that name to the service's address (DNS rebinding), and then Host holds that name. So Host must be a
// name that the operator has given, or a numeric address, which no name server can redirect.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "api/message/message.h"

namespace selenograph::server {

// Headers by lower-case name.
using Headers = std::multimap<std::string, std::string>;

// A completed request. `path` is without query; empty when the request was unreadable.
struct AccessRecord {
  std::string method{}, path{};
  std::string target{};  // as sent, with '?' for control characters
  int status = 0;
  std::size_t bytes = 0;  // of the answer's body, even if the client disconnected before it had all
  double seconds = 0;     // from the complete request to the last byte handed to the system
  std::string error_code{};
  std::string request_id{};         // also in the response: X-Request-Id
  std::string token{};              // name of the token that a trusted proxy accepted; empty: none
  std::string host{};               // numeric address of the client or proxy
  std::size_t request_bytes = 0;    // size of its body
  double queued_s = 0, work_s = 0;  // time in the queue, and the rest of the time to the finished answer
  api::StageTimes stages{};         // as in Server-Timing
};

// Returns the header's value if it is the only one and a plain name (1 to 64 letters, digits, '.', '_', '-'), else "".
std::string plain_name(const Headers& headers, const std::string& header);

// Returns a name that no other request has.
std::string new_request_id();

// Returns true for a numeric address of this machine alone.
inline bool is_loopback(std::string_view address) { return address.starts_with("127.") || address == "::1"; }

// Returns nothing if the request is accepted, else its problem. Hosts are compared without case, final dot and port: a
// forwarded port differs, and a rebound page has the right one. Of several headers each must be accepted.
//  - "misdirected_request": Host is none of `own` and `allowed`. A request without Host passes: browsers always send
//  one;
//  - "foreign_origin": Origin is neither http(s)://Host nor, on any port, one of `allowed`. "null" (a file, a sandboxed
//    frame) is always foreign.
std::optional<api::Response> refusal_by_host(const Headers& headers, const std::vector<std::string>& own,
                                             const std::vector<std::string>& allowed);

}  // namespace selenograph::server
