// The web pages: GET / (a map, a camera's frame, service status) and GET /docs (the API document). Each is one file of
// page/, embedded in the executable; they use the public API.
#pragma once

#include <optional>
#include <string_view>

#include "api/message/message.h"

namespace selenograph::server {

enum class PageAccess {
  off,    // nobody may open the pages
  local,  // loopback peers only
  on,     // everybody
};

// Contents of page/page.html, page/docs.html, and Debian's marked.js, which renders the Markdown of the API document's
// descriptions. deploy/support/embed.cmake generates these functions.
std::string_view page_html();
std::string_view docs_html();
std::string_view marked_js();

// Returns nothing if the request's path is not a page, or its peer may not open it: the request is then answered like
// one for any other path.
std::optional<api::Response> page_for(const api::Request& request, PageAccess access);

}  // namespace selenograph::server
