// The head of a request, as cpp-httplib has parsed it, and the checks that the library leaves to its user.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "server/http/caller.h"

namespace selenograph::server {

inline constexpr std::size_t kMaxTargetBytes = 2048;

// Reason to refuse a request: a row of the api's error table, and details.
struct Refusal {
  std::string error_code;
  std::string detail;
};

struct RequestHead {
  std::string method;
  std::string target;  // as sent
  bool http_1_0 = false;
  Headers headers;
  // Authority of the request, as sent: of an absolute target, else Host (RFC 9112 3.2.2); only HTTP/1.0 may have none.
  // AllowedHosts checks it.
  std::optional<std::string> authority{};
};

// Sets the authority. "http://host/path" means "/path" of that host: returns this path, or the target itself.
std::string resolve_authority(RequestHead& head);

// Empty: the request is accepted.
//  - "malformed_request": Content-Length twice, with Transfer-Encoding, or not a number; another coding than `chunked`,
//    or any in HTTP/1.0; not exactly one Host; a control character in the target; a header name that is not a token;
//  - "not_implemented": a method that HTTP does not have;
//  - "uri_too_long": a target of more than kMaxTargetBytes;
//  - "too_large": a Content-Length above `max_body_bytes`;
//  - "unsupported_media_type": a Content-Encoding other than identity.
std::optional<Refusal> refusal_of(const RequestHead& head, std::size_t max_body_bytes);

// A method of RFC 9110 or RFC 5789.
bool is_http_method(std::string_view method);
bool has_control(std::string_view text);
// Whether a body follows the head.
bool announces_body(const RequestHead& head);
// Whether the connection ends with the answer. A body of other methods than POST is never read, so it ends there, too.
bool ends_connection(const RequestHead& head);

}  // namespace selenograph::server
