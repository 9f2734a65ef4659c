// The pages for people: GET / (a map, a camera's frame, what it says of itself) and GET /docs (the API document). Each
// is one file of page/, in the executable; they ask the same service that everybody asks.
#pragma once

#include <optional>
#include <string_view>

#include "api/message/message.h"
#include "server/http/connection.h"

namespace selenograph::server {

// To whom they are served: nobody, peers of the loopback interface, everybody.
enum class PageAccess { off, local, on };

// page/page.html, page/docs.html, and Debian's marked.js, which renders the Markdown of the document's descriptions;
// made by deploy/support/embed.cmake.
std::string_view page_html();
std::string_view docs_html();
std::string_view marked_js();

// Nothing where the request is for no page, or the peer doesn't get any: it is then answered as any other path.
std::optional<api::Response> page_for(const api::Request& request, const Peer& peer, PageAccess access);

}  // namespace selenograph::server
