// A request's identity: its id, the token that a proxy accepted, and its record for log and metrics.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <string_view>

#include "api/message/message.h"

namespace selenograph::server {

// Headers by lower-case name.
using Headers = std::multimap<std::string, std::string>;

// A completed request. `path` is without query; empty when the request was unreadable.
struct AccessRecord {
  std::string method, path;
  std::string target;  // as sent, free of control characters
  int status = 0;
  std::size_t bytes = 0;  // bytes of the body handed to the system: not all if the client disconnected before
  double seconds = 0;     // from the complete request to the last byte handed to the system
  std::string error_code;
  std::string request_id;           // also in the response: X-Request-Id
  std::string token;                // name of the token that a trusted proxy accepted; empty: none
  std::string host;                 // numeric address of the client or proxy
  std::size_t request_bytes = 0;    // size of its body
  double queued_s = 0, work_s = 0;  // time in the queue, and the rest of the time to the finished answer
  api::StageTimes stages{};         // as in Server-Timing
};

// Returns X-Request-Id if there is exactly one and it is a plain name (1 to 64 letters, digits, '.', '_' and '-'),
// else a new id.
std::string request_id_of(const Headers& headers);

// Returns the name of a token from the header Selenograph-Token, which a trusted proxy sets; empty without the header,
// or if it is not a plain name. Call it only for requests from a trusted proxy: any client can send the header.
std::string token_of(const Headers& headers);

// Returns true for a numeric address of this machine alone.
bool is_loopback(std::string_view address);

}  // namespace selenograph::server
