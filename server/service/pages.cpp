#include "server/service/pages.h"

#include <string>

#include "server/http/caller.h"

namespace selenograph::server {
namespace {

// All that a page loads is in it, or this service's; nobody frames it.
constexpr char kPolicy[] =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; img-src 'self' "
    "blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

}  // namespace

std::optional<api::Response> page_for(const api::Request& request, const Peer& peer, PageAccess access) {
  const bool page = request.path == "/", docs = request.path == "/docs";
  if (request.method != "GET" || (!page && !docs)) return std::nullopt;
  // A proxy on this machine is local, too: with one in front, --page off.
  if (access == PageAccess::off || (access == PageAccess::local && !is_loopback(peer.host))) return std::nullopt;
  api::Response answer;
  answer.content_type = "text/html; charset=utf-8";
  answer.headers = {{"Content-Security-Policy", kPolicy},
                    {"X-Content-Type-Options", "nosniff"},
                    {"Referrer-Policy", "no-referrer"},
                    {"Cache-Control", "no-cache"}};
  answer.body = page ? page_html() : docs_html();
  return answer;
}

}  // namespace selenograph::server
