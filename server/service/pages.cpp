#include "server/service/pages.h"

#include <map>
#include <string>
#include <tuple>
#include <utility>

#include "server/http/access.h"

namespace selenograph::server {
namespace {

// A page loads only what it embeds or this service serves, and no other page may frame it.
constexpr char kPolicy[] =
    "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; "
    "img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

}  // namespace

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
  api::Response answer;
  answer.headers = {{"Content-Security-Policy", kPolicy},
                    {"X-Content-Type-Options", "nosniff"},
                    {"Referrer-Policy", "no-referrer"},
                    {"Cache-Control", "no-cache"}};
  std::tie(answer.content_type, answer.body) = page->second;
  return answer;
}

}  // namespace selenograph::server
