// The head of an HTTP request: what is accepted may go to the HTTP library, which is more lenient than we are.
#include <string>
#include <variant>

#include "api/message/problem.h"
#include "server/http/allowed_hosts.h"
#include "server/http/request_head.h"
#include "tests/fuzz/fuzz.h"

namespace selenograph::fuzz {
namespace {

using server::RequestHead;

constexpr std::size_t kMaxBody = 1000;

// Lines end with CRLF, and neither byte is anywhere else.
bool clean_lines(const std::string& text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '\r' && (i + 1 == text.size() || text[i + 1] != '\n')) return false;
    if (text[i] == '\n' && (i == 0 || text[i - 1] != '\r')) return false;
    if (text[i] == '\0') return false;
  }
  return true;
}

void check_accepted(const RequestHead& head) {
  require(head.text.ends_with("\r\n\r\n") && head.text.find("\r\n\r\n") + 4 == head.text.size(),
          "one empty line, at the end");
  require(clean_lines(head.text), "the library sees CRLF only", head.text);
  require(!head.target.empty() && head.target.size() <= server::kMaxTargetBytes, "the target fits");
  for (const char* hidden : {"\r\nrange:", "\r\nif-range:", "\r\naccept-encoding:", "\r\ncontent-type:"})
    require(head.text.find(hidden) == std::string::npos, "hidden from the library:", hidden);
  require(head.headers.count("content-length") + head.headers.count("transfer-encoding") <= 1, "one length");
  require(head.close || head.headers.count("host") == 1, "one host");
  require(head.authority || head.http_1_0, "it is for somebody");
  const auto refused = server::AllowedHosts("127.0.0.1", {"moon.example"}).refusal(head, "10.0.0.1");
  const int status = refused ? api::error_row(refused->error_code).status : 200;
  require(status == 200 || status == 400 || status == 403 || status == 421, "a host is taken or refused");
  require(head.body_bytes <= kMaxBody && !(head.chunked && head.body_bytes > 0),
          "the body to read is bounded, and one");
  require(!(head.chunked && head.http_1_0), "no chunks in HTTP/1.0");
  for (std::size_t at = 0, end; (end = head.text.find("\r\n", at)) != std::string::npos; at = end + 2)
    require(end - at <= 8192 - 2, "the library takes every line");

  const auto again = server::check_head(head.text, kMaxBody);
  const auto* same = std::get_if<RequestHead>(&again);
  require(same != nullptr, "what was made is acceptable", head.text);
  require(same->text == head.text && same->method == head.method && same->target == head.target,
          "rewriting is idempotent", head.text);
}

}  // namespace
}  // namespace selenograph::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace selenograph;
  // Its reader hands over what ends with an empty line, and no more than this.
  if (size > server::kMaxHeadBytes) return 0;
  const std::string raw = std::string(fuzz::text_of(data, size)) + "\r\n\r\n";
  const auto checked = server::check_head(raw, fuzz::kMaxBody);
  if (const auto* head = std::get_if<server::RequestHead>(&checked)) {
    fuzz::check_accepted(*head);
  } else {
    const int status = api::error_row(std::get<server::HeadProblem>(checked).error_code).status;
    fuzz::require((status >= 400 && status < 500) || status == 501,
                  "a refusal is the client's fault, or a method that HTTP doesn't have");
  }
  return 0;
}
