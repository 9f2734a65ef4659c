#include "server/http/request_head.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <optional>
#include <vector>

#include "dem/files/names.h"
#include "server/http/field_syntax.h"

namespace selenograph::server {
namespace {

using Refusal = std::optional<HeadProblem>;

// Those of RFC 9110 and RFC 5789: known here, whether or not a path has them.
constexpr std::string_view kMethods[] = {"GET",     "HEAD",    "POST",  "PUT",  "DELETE",
                                         "CONNECT", "OPTIONS", "TRACE", "PATCH"};

// What the library must not act on, because we do not offer it (a body is JSON or a file, never a form), and what
// check_framing() writes anew.
constexpr std::string_view kHidden[] = {"range",          "if-range",          "accept-encoding", "content-type",
                                        "content-length", "transfer-encoding", "expect"};

HeadProblem malformed(std::string detail) { return {"malformed_request", std::move(detail)}; }

std::vector<std::string_view> lines_of(std::string_view raw) {
  std::vector<std::string_view> lines;
  for (std::size_t end; (end = raw.find("\r\n")) != std::string_view::npos && end > 0; raw.remove_prefix(end + 2)) {
    lines.push_back(raw.substr(0, end));
  }
  return lines;
}

// "http://host/path" means "/path" of that host (RFC 9112 3.2.2).
void read_target(std::string_view target, RequestHead& head) {
  head.target = target;
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (!target.starts_with(scheme)) continue;
    target.remove_prefix(scheme.size());
    const std::size_t path = target.find('/');
    head.authority = target.substr(0, path);
    head.target = path == std::string_view::npos ? "/" : target.substr(path);
    return;
  }
}

Refusal read_request_line(std::string_view line, RequestHead& head) {
  const std::size_t first = line.find(' '), last = line.rfind(' ');
  if (first == std::string_view::npos || first == last)
    return malformed("the request line is not 'METHOD target HTTP/1.1'");
  const std::string_view target = line.substr(first + 1, last - first - 1), version = line.substr(last + 1);
  head.method = line.substr(0, first);
  read_target(target, head);
  if (!is_token(head.method)) return malformed("the method is not a token");
  if (std::find(std::begin(kMethods), std::end(kMethods), head.method) == std::end(kMethods))
    return HeadProblem{"not_implemented", "no resource here has the method " + head.method.substr(0, 40)};
  if (target.size() > kMaxTargetBytes) {
    return HeadProblem{"uri_too_long",
                       "the request target has more than " + std::to_string(kMaxTargetBytes) + " bytes"};
  }
  if (has_control(target) || target.find_first_of(" \t") != std::string_view::npos || head.target.empty()) {
    return malformed("the request target holds blanks or control characters");
  }
  if (version != "HTTP/1.1" && version != "HTTP/1.0")
    return malformed("unsupported HTTP version: HTTP/1.1 and HTTP/1.0 are supported");
  head.http_1_0 = head.close = version == "HTTP/1.0";
  head.text = head.method + ' ' + head.target + ' ' + std::string(version) + "\r\n";
  return {};
}

Refusal read_header_line(std::string_view line, RequestHead& head) {
  if (line.size() > kMaxHeaderLineBytes) {
    return HeadProblem{"headers_too_large",
                       "a header line has more than " + std::to_string(kMaxHeaderLineBytes) + " bytes"};
  }
  // Folded lines and blanks before the colon end here, too.
  if (!is_field_line(line)) return malformed("a header line is not 'Name: value', or holds control characters");
  const std::size_t colon = line.find(':');
  const std::string_view value = without_blanks(line.substr(colon + 1));
  std::string name = dem::lower(line.substr(0, colon));
  if (std::find(std::begin(kHidden), std::end(kHidden), name) == std::end(kHidden)) {
    head.text.append(name).append(": ").append(value).append("\r\n");
  }
  head.headers.emplace(std::move(name), value);
  return {};
}

const std::string* only(const RequestHead& head, const std::string& name) {
  return head.headers.count(name) == 1 ? &head.headers.find(name)->second : nullptr;
}

Refusal check_length(RequestHead& head, std::size_t max_body_bytes) {
  const std::string* length = only(head, "content-length");
  if (!length) return {};
  const auto [end, error] = std::from_chars(length->data(), length->data() + length->size(), head.body_bytes);
  const bool digits =
      !length->empty() && std::all_of(length->begin(), length->end(), [](unsigned char c) { return std::isdigit(c); });
  if (!digits) return malformed("Content-Length is not a number");
  if (error != std::errc{} || end != length->data() + length->size() || head.body_bytes > max_body_bytes) {
    return HeadProblem{"too_large", "the body has " + length->substr(0, 40) + " bytes, at most " +
                                        std::to_string(max_body_bytes) + " are taken"};
  }
  return {};
}

Refusal check_framing(RequestHead& head, std::size_t max_body_bytes) {
  const auto lengths = head.headers.count("content-length"), codings = head.headers.count("transfer-encoding");
  if (lengths + codings > 1) return malformed("the length of the body is given more than once");
  head.chunked = codings == 1;
  if (head.chunked && head.http_1_0) return malformed("HTTP/1.0 has no Transfer-Encoding");
  if (head.chunked && dem::lower(*only(head, "transfer-encoding")) != "chunked") {
    return malformed("the only Transfer-Encoding understood is chunked");
  }
  const std::string* coding = only(head, "content-encoding");
  if (head.headers.count("content-encoding") > 1 || (coding && dem::lower(*coding) != "identity")) {
    return HeadProblem{"unsupported_media_type", "bodies with a Content-Encoding are not taken"};
  }
  if (Refusal refusal = check_length(head, max_body_bytes)) return refusal;
  if (head.method == "POST") {
    head.text +=
        head.chunked ? "transfer-encoding: chunked\r\n" : "content-length: " + std::to_string(head.body_bytes) + "\r\n";
    const std::string* expected = only(head, "expect");
    const bool body_follows = head.chunked || head.body_bytes > 0;
    if (body_follows && expected && !head.http_1_0 && dem::lower(*expected) == "100-continue")
      head.text += "expect: 100-continue\r\n";
  } else if (lengths + codings > 0) {
    head.close = true;
    head.chunked = false;
    head.body_bytes = 0;
  }
  return {};
}

// Connection is a list, and may come in several lines.
bool asks_to_close(const RequestHead& head) {
  const auto [first, last] = head.headers.equal_range("connection");
  return std::any_of(first, last, [](const auto& header) {
    for (std::string_view rest = header.second; !rest.empty();) {
      const std::size_t comma = rest.find(',');
      if (dem::lower(without_blanks(rest.substr(0, comma))) == "close") return true;
      rest.remove_prefix(std::min(comma == std::string_view::npos ? rest.size() : comma + 1, rest.size()));
    }
    return false;
  });
}

}  // namespace

std::variant<RequestHead, HeadProblem> check_head(std::string_view raw, std::size_t max_body_bytes) {
  RequestHead head;
  const std::vector<std::string_view> lines = lines_of(raw);
  if (lines.empty()) return malformed("the request is empty");
  if (Refusal refusal = read_request_line(lines.front(), head)) return *refusal;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    if (Refusal refusal = read_header_line(lines[i], head)) return *refusal;
  }
  const auto hosts = head.headers.count("host");
  if (hosts > 1 || (hosts == 0 && !head.http_1_0)) return malformed("exactly one Host header is needed");
  if (hosts == 1 && !head.authority) head.authority = *only(head, "host");
  if (Refusal refusal = check_framing(head, max_body_bytes)) return *refusal;
  head.close = head.close || asks_to_close(head);
  head.text += "\r\n";
  return head;
}

}  // namespace selenograph::server
