#include "server/service/front.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <tuple>
#include <utility>

#include "api/message/problem.h"
#include "server/http/access.h"

namespace selenograph::server {
namespace {

api::Response text_answer(int status, std::string body, std::string content_type = "text/plain; charset=utf-8") {
  api::Response answer;
  answer.status = status;
  answer.content_type = std::move(content_type);
  answer.headers = {{"Cache-Control", "no-store"}};
  answer.body = std::move(body);
  return answer;
}

// Returns the problem of a method other than GET and HEAD.
api::Response get_only() {
  api::Response answer = api::problem("method_not_allowed", "this path supports only GET");
  answer.headers.emplace_back("Allow", "GET, HEAD");
  return answer;
}

// A page loads only what it embeds or this service serves, and no other page may frame it.
constexpr char kPolicy[] =
    "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; "
    "img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

// Returns nothing if the request's path is not a page, or its peer may not open it: the request is then answered like
// one for any other path.
std::optional<api::Response> page_for(const api::Request& request, PageAccess access) {
  constexpr std::string_view kHtml = "text/html; charset=utf-8";
  static const std::map<std::string_view, std::pair<std::string_view, std::string_view>> kPages = {
      {"/", {kHtml, page_html()}},
      {"/docs", {kHtml, docs_html()}},
      {"/marked.js", {"text/javascript; charset=utf-8", marked_js()}},
  };
  const auto page = kPages.find(request.path);
  if (page == kPages.end()) return std::nullopt;
  // Requests through a proxy on this machine count as local: behind one, use --page off.
  if (access == PageAccess::off || (access == PageAccess::local && !is_loopback(request.peer))) return std::nullopt;
  if (request.method != "GET") return get_only();
  api::Response answer;
  answer.headers = {{"Content-Security-Policy", kPolicy},
                    {"X-Content-Type-Options", "nosniff"},
                    {"Referrer-Policy", "no-referrer"},
                    {"Cache-Control", "no-cache"}};
  std::tie(answer.content_type, answer.body) = page->second;
  return answer;
}

}  // namespace

Front::Front(const api::Service& service, const Metrics& metrics, PageAccess pages, ReadGauges read_gauges)
    : service_(service), metrics_(metrics), pages_(pages), read_gauges_(std::move(read_gauges)) {}

api::Response Front::handle(const api::Request& request) const {
  return api::answer_or_problem(request, [&] {
    const bool is_probe = std::ranges::find(kProbePaths, request.path) != kProbePaths.end();
    return is_probe ? answer_own_path(request) : answer_other_path(request);
  });
}

api::Response Front::answer_other_path(const api::Request& request) const {
  if (request.method == "HEAD") {
    api::Request get = request;
    get.method = "GET";
    return answer_other_path(get);
  }
  if (auto page = page_for(request, pages_)) return std::move(*page);
  return service_.handle(request);
}

api::Response Front::answer_own_path(const api::Request& request) const {
  if (request.method != "GET" && request.method != "HEAD") return get_only();
  if (request.path == "/health/live") return text_answer(200, "ok\n");
  Gauges gauges;
  gauges.ready = ready_;
  read_gauges_(gauges);
  if (request.path == "/metrics")
    return text_answer(200, metrics_.exposition(gauges), "text/plain; version=0.0.4; charset=utf-8");
  if (!ready_) return text_answer(503, "shutting down\n");
  api::Response answer =
      text_answer(200, gauges.cache_trouble.empty() ? "ok\n" : fmt::format("ok\n{}\n", gauges.cache_trouble));
  answer.headers.emplace_back("Selenograph-Build", build_id());
  return answer;
}

}  // namespace selenograph::server
