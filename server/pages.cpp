#include "server/pages.h"

#include <string>

namespace selenograph::server {
namespace {

// A proxy on this machine is a peer like this, too: with one in front, --page off.
bool is_loopback(const std::string& address) {
  return address.starts_with("127.") || address == "::1" || address.starts_with("::ffff:127.");
}

// All that a page loads is in it, or this service's; nobody frames it.
constexpr char kPolicy[] =
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; img-src 'self' "
    "blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

}  // namespace

std::optional<api::Response> page_for(const api::Request& request, const Peer& peer, PageAccess access) {
  const bool page = request.path == "/", docs = request.path == "/docs";
  if (request.method != "GET" || (!page && !docs)) return std::nullopt;
  if (access == PageAccess::off || (access == PageAccess::local && !is_loopback(peer.address))) return std::nullopt;
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
