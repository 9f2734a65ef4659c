#include "server/http/request_head.h"

#include <algorithm>
#include <charconv>
#include <string_view>

#include "dem/base/names.h"

namespace selenograph::server {
namespace {

using MaybeRefusal = std::optional<Refusal>;

constexpr std::string_view kMethods[] = {"GET",     "HEAD",    "POST",  "PUT",  "DELETE",
                                         "CONNECT", "OPTIONS", "TRACE", "PATCH"};

Refusal malformed(std::string detail) { return {"malformed_request", std::move(detail)}; }

// Returns the header's value, and null unless there is exactly one.
const std::string* only(const RequestHead& head, const std::string& name) {
  return head.headers.count(name) == 1 ? &head.headers.find(name)->second : nullptr;
}

// Checks method, target, header names and Host.
MaybeRefusal check_names(const RequestHead& head) {
  if (!is_http_method(head.method))
    return Refusal{"not_implemented", "no resource here has the method " + head.method.substr(0, 40)};
  if (head.target.size() > kMaxTargetBytes)
    return Refusal{"uri_too_long", "the request target has more than " + std::to_string(kMaxTargetBytes) + " bytes"};
  if (has_control(head.target)) return malformed("the request target holds control characters");
  for (const auto& [name, value] : head.headers)
    if (!dem::consists_of(name, "!#$%&'*+-.^_`|~")) return malformed("a header line is not 'Name: value'");
  const auto hosts = head.headers.count("host");
  if (hosts > 1 || (hosts == 0 && !head.http_1_0)) return malformed("exactly one Host header is needed");
  return {};
}

// Checks the value of Content-Length.
MaybeRefusal check_length(const std::string& length, std::size_t max_body_bytes) {
  if (!std::all_of(length.begin(), length.end(), [](char c) { return c >= '0' && c <= '9'; }))
    return malformed("Content-Length is not a number");
  // A number beyond 64 bits is an error of from_chars(), and too large as well.
  std::size_t bytes = 0;
  const auto error = std::from_chars(length.data(), length.data() + length.size(), bytes).ec;
  if (error == std::errc{} && bytes <= max_body_bytes) return {};
  return Refusal{"too_large", "the body has " + length.substr(0, 40) + " bytes, at most " +
                                  std::to_string(max_body_bytes) + " are taken"};
}

// Refuses every request whose length two readers could understand differently (request smuggling).
MaybeRefusal check_framing(const RequestHead& head, std::size_t max_body_bytes) {
  const auto lengths = head.headers.count("content-length");
  const auto codings = head.headers.count("transfer-encoding");
  if (lengths + codings > 1) return malformed("the length of the body is given more than once");
  if (codings == 1 && head.http_1_0) return malformed("HTTP/1.0 has no Transfer-Encoding");
  if (codings == 1 && dem::lower(*only(head, "transfer-encoding")) != "chunked")
    return malformed("the only Transfer-Encoding understood is chunked");
  const std::string* coding = only(head, "content-encoding");
  if (head.headers.count("content-encoding") > 1 || (coding && dem::lower(*coding) != "identity"))
    return Refusal{"unsupported_media_type", "bodies with a Content-Encoding are not taken"};
  return lengths == 1 ? check_length(*only(head, "content-length"), max_body_bytes) : std::nullopt;
}

}  // namespace

std::string resolve_authority(RequestHead& head) {
  if (const std::string* host = only(head, "host")) head.authority = *host;
  // An absolute target, as clients send it to a proxy, has precedence over Host.
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (!head.target.starts_with(scheme)) continue;
    const std::size_t path = head.target.find('/', scheme.size());
    head.authority = head.target.substr(scheme.size(), path - scheme.size());
    return path == std::string::npos ? "/" : head.target.substr(path);
  }
  return head.target;
}

MaybeRefusal refusal_of(const RequestHead& head, std::size_t max_body_bytes) {
  const MaybeRefusal refusal = check_names(head);
  return refusal ? refusal : check_framing(head, max_body_bytes);
}

bool is_http_method(std::string_view method) {
  return std::find(std::begin(kMethods), std::end(kMethods), method) != std::end(kMethods);
}

bool has_control(std::string_view text) {
  return std::any_of(text.begin(), text.end(), [](unsigned char c) { return c < 32 || c == 127; });
}

bool announces_body(const RequestHead& head) {
  const std::string* length = only(head, "content-length");
  return head.headers.contains("transfer-encoding") || (length && length->find_first_not_of('0') != std::string::npos);
}

bool ends_connection(const RequestHead& head) {
  const auto [first, last] = head.headers.equal_range("connection");
  return head.http_1_0 || (head.method != "POST" && announces_body(head)) ||
         std::any_of(first, last,
                     [](const auto& header) { return dem::lower(header.second).find("close") != std::string::npos; });
}

}  // namespace selenograph::server
