// The web pages: GET / (a map, a camera's frame, service status) and GET /docs (the API document). Each is one file of
// page/, embedded in the executable; they use the public API.
#pragma once

#include <optional>
#include <string_view>

#include "api/message/message.h"
#include "server/http/caller.h"

namespace selenograph::server {

// Who may open them: nobody, loopback peers, everybody.
enum class PageAccess { off, local, on };

// page/page.html, page/docs.html, and Debian's marked.js, which renders the Markdown of the document's descriptions;
// made by deploy/support/embed.cmake.
std::string_view page_html();
std::string_view docs_html();
std::string_view marked_js();

// Empty if the request's path, whatever its method, is no page, or the peer may not open it: it is then answered like
// any other path.
std::optional<api::Response> page_for(const api::Request& request, const Peer& peer, PageAccess access);

}  // namespace selenograph::server
