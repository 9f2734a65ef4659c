// The head of a request, as cpp-httplib has parsed it, and the checks that the library leaves to its user.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "server/http/caller.h"

namespace selenograph::server {

inline constexpr std::size_t kMaxTargetBytes = 2048;

// Reason to refuse a request: the code of a row of the api's error table, and details.
struct Refusal {
  std::string error_code;
  std::string detail;
};

struct RequestHead {
  std::string method;
  std::string target;  // as sent
  bool http_1_0 = false;
  Headers headers;
  // Authority as sent: that of an absolute target, else Host (RFC 9112 3.2.2); only HTTP/1.0 may have none.
  // AllowedHosts checks it.
  std::optional<std::string> authority{};
};

// Sets the authority, and returns the target's path: "/path" for "http://host/path", else the target itself.
std::string resolve_authority(RequestHead& head);

// Returns nothing if the request is accepted, else one of
//  - "malformed_request": Content-Length twice, with Transfer-Encoding, or not a number; another coding than `chunked`,
//    or any in HTTP/1.0; not exactly one Host; a control character in the target; a header name that is not a token;
//  - "not_implemented": a method that HTTP does not have;
//  - "uri_too_long": a target of more than kMaxTargetBytes;
//  - "too_large": a Content-Length above `max_body_bytes`;
//  - "unsupported_media_type": a Content-Encoding other than identity.
std::optional<Refusal> refusal_of(const RequestHead& head, std::size_t max_body_bytes);

// Returns true for a method of RFC 9110 or RFC 5789.
bool is_http_method(std::string_view method);
bool has_control(std::string_view text);
// Returns true if a body follows the head.
bool announces_body(const RequestHead& head);
// Returns true if the connection must be closed after the answer: on request, for HTTP/1.0, and after a body of a
// method other than POST, which is never read.
bool ends_connection(const RequestHead& head);

}  // namespace selenograph::server
