#include "server/request_head.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <optional>
#include <vector>

namespace selenograph::server {
namespace {

using Refusal = std::optional<HeadProblem>;

HeadProblem malformed(std::string detail) { return {"malformed_request", std::move(detail)}; }

bool is_token(std::string_view s) {  // RFC 9110 5.6.2
  constexpr std::string_view kOther = "!#$%&'*+-.^_`|~";
  return !s.empty() && std::all_of(s.begin(), s.end(), [&](unsigned char c) {
    return (c < 128 && std::isalnum(c)) || kOther.find(static_cast<char>(c)) != std::string_view::npos;
  });
}

bool has_control(std::string_view s) {
  return std::any_of(s.begin(), s.end(), [](unsigned char c) { return (c < 32 && c != '\t') || c == 127; });
}

std::string lower(std::string_view s) {
  std::string out(s);
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return out;
}

std::string_view trim(std::string_view s) {
  while (!s.empty() && (s.front() == ' ' || s.front() == '\t')) s.remove_prefix(1);
  while (!s.empty() && (s.back() == ' ' || s.back() == '\t')) s.remove_suffix(1);
  return s;
}

std::vector<std::string_view> lines_of(std::string_view raw) {
  std::vector<std::string_view> lines;
  for (std::size_t end; (end = raw.find("\r\n")) != std::string_view::npos && end > 0; raw.remove_prefix(end + 2)) {
    lines.push_back(raw.substr(0, end));
  }
  return lines;
}

// "http://host/path" means "/path" (RFC 9112 3.2.2).
std::string_view origin_form(std::string_view target) {
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (target.substr(0, scheme.size()) != scheme) continue;
    const std::size_t path = target.find('/', scheme.size());
    return path == std::string_view::npos ? "/" : target.substr(path);
  }
  return target;
}

Refusal read_request_line(std::string_view line, RequestHead& head) {
  const std::size_t first = line.find(' '), last = line.rfind(' ');
  if (first == std::string_view::npos || first == last)
    return malformed("the request line is not 'METHOD target HTTP/1.1'");
  const std::string_view target = line.substr(first + 1, last - first - 1), version = line.substr(last + 1);
  head.method = line.substr(0, first);
  head.target = origin_form(target);
  if (!is_token(head.method)) return malformed("the method is not a token");
  if (target.size() > kMaxTargetBytes) {
    return HeadProblem{"uri_too_long",
                       "the request target has more than " + std::to_string(kMaxTargetBytes) + " bytes"};
  }
  if (has_control(target) || target.find_first_of(" \t") != std::string_view::npos || head.target.empty()) {
    return malformed("the request target holds blanks or control characters");
  }
  if (version != "HTTP/1.1" && version != "HTTP/1.0") return malformed("only HTTP/1.1 and HTTP/1.0 are spoken here");
  head.close = version == "HTTP/1.0";
  head.text = head.method + ' ' + head.target + ' ' + std::string(version) + "\r\n";
  return {};
}

Refusal read_header_line(std::string_view line, RequestHead& head) {
  const std::size_t colon = line.find(':');
  if (colon == std::string_view::npos || !is_token(line.substr(0, colon))) {
    return malformed("a header line is not 'Name: value'");  // folded lines and blanks before the colon end here, too
  }
  const std::string_view value = trim(line.substr(colon + 1));
  if (has_control(value)) return malformed("a header value holds control characters");
  std::string name = lower(line.substr(0, colon));
  static constexpr std::string_view kHidden[] = {"range", "if-range", "accept-encoding"};
  if (std::find(std::begin(kHidden), std::end(kHidden), name) == std::end(kHidden)) {
    head.text.append(name).append(": ").append(value).append("\r\n");
  }
  head.headers.emplace(std::move(name), value);
  return {};
}

const std::string* only(const RequestHead& head, const std::string& name) {
  return head.headers.count(name) == 1 ? &head.headers.find(name)->second : nullptr;
}

Refusal check_length(const RequestHead& head, std::size_t max_body_bytes) {
  const std::string* length = only(head, "content-length");
  if (!length) return {};
  std::size_t bytes = 0;
  const auto [end, error] = std::from_chars(length->data(), length->data() + length->size(), bytes);
  const bool digits =
      !length->empty() && std::all_of(length->begin(), length->end(), [](unsigned char c) { return std::isdigit(c); });
  if (!digits) return malformed("Content-Length is not a number");
  if (error != std::errc{} || end != length->data() + length->size() || bytes > max_body_bytes) {
    return HeadProblem{"too_large",
                       "the body has " + *length + " bytes, at most " + std::to_string(max_body_bytes) + " are taken"};
  }
  return {};
}

Refusal check_framing(RequestHead& head, std::size_t max_body_bytes) {
  const auto lengths = head.headers.count("content-length"), codings = head.headers.count("transfer-encoding");
  if (lengths + codings > 1) return malformed("the length of the body is given more than once");
  if (codings == 1 && lower(*only(head, "transfer-encoding")) != "chunked") {
    return malformed("the only Transfer-Encoding understood is chunked");
  }
  const std::string* coding = only(head, "content-encoding");
  if (head.headers.count("content-encoding") > 1 || (coding && lower(*coding) != "identity")) {
    return HeadProblem{"unsupported_media_type", "bodies with a Content-Encoding are not taken"};
  }
  if (Refusal refusal = check_length(head, max_body_bytes)) return refusal;
  if (head.method == "POST" && lengths + codings == 0) head.text += "content-length: 0\r\n";
  if (head.method != "POST" && lengths + codings > 0) head.close = true;
  return {};
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
  if (!head.close && head.headers.count("host") != 1) return malformed("exactly one Host header is needed");
  if (Refusal refusal = check_framing(head, max_body_bytes)) return *refusal;
  if (const std::string* connection = only(head, "connection"); connection && lower(*connection) == "close")
    head.close = true;
  head.text += "\r\n";
  return head;
}

}  // namespace selenograph::server
