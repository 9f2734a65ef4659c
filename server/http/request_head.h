// The head of a request (request line and header lines) as it came over the wire, checked before the HTTP library sees
// it.
//
// cpp-httplib 0.11.4 is lenient where leniency is dangerous behind a proxy (two lengths, folded lines, bare line feeds,
// sizes of chunks), and it acts on headers that this service does not support (ranges, content codings, forms). So a
// head is either refused here, or rewritten to what the library may see.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

namespace selenograph::server {

inline constexpr std::size_t kMaxHeadBytes = 16384;
inline constexpr std::size_t kMaxTargetBytes = 2048;
inline constexpr std::size_t kMaxHeaderLineBytes = 8000;  // the library takes 8192 with what rewriting adds

struct RequestHead {
  std::string method;
  std::string target;                               // as sent: path and query, free of control characters
  std::multimap<std::string, std::string> headers;  // lower-case names; everything that was sent
  // Authority of the request, as sent: of an absolute target, else Host (RFC 9112 3.2.2); only HTTP/1.0 may have none.
  // AllowedHosts checks it.
  std::optional<std::string> authority;
  std::string text;    // the head for the library, with its empty line
  bool close = false;  // the connection must end after the answer
  bool http_1_0 = false;
  // Body that follows: chunked, or body_bytes long; methods other than POST have none.
  bool chunked = false;
  std::size_t body_bytes = 0;
};

// Reason of a refusal: a row of the api's error table, and details.
struct HeadProblem {
  std::string error_code;
  std::string detail;
};

// `raw` ends with the empty line ("\r\n\r\n"). Rules of RFC 9112, strictly:
//  - Content-Length together with Transfer-Encoding, two of either, another coding than `chunked`, or any in HTTP/1.0:
//    refused;
//  - a Content-Length above max_body_bytes, or a Content-Encoding other than identity: refused before a byte of the
//    body is read;
//  - Range and If-Range are removed (RFC 9110 14.2 allows a server to ignore them), and so is Accept-Encoding: the same
//    request gets the same bytes, complete and unencoded, and the ETag identifies them; the handlers check
//    Content-Type;
//  - a POST without any length has an empty body;
//  - a method that HTTP does not have is "not_implemented"; whether the path has the method is not checked here;
//  - a body on another method is never read, therefore the connection ends with the answer.
std::variant<RequestHead, HeadProblem> check_head(std::string_view raw, std::size_t max_body_bytes);

}  // namespace selenograph::server
