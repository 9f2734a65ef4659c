// Dispatches requests between the HTTP server and the service: health, metrics, and the web pages: GET / (a map, a
// camera's frame, service status) and GET /docs (the API document). Each is one file of page/, embedded in the
// executable; they use the public API.
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "api/service.h"
#include "server/service/metrics.h"

namespace selenograph::server {

// Paths that are answered whatever else the service does.
inline const std::vector<std::string> kProbePaths{"/health/live", "/health/ready", "/metrics"};

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

class Front {
 public:
  using ReadGauges = std::function<void(Gauges&)>;  // fills gauges known to the owner: terrain, queue, ...

  Front(const api::Service& service, const Metrics& metrics, PageAccess pages, ReadGauges read_gauges);

  // Answers health and metrics, which never queue, and the pages; all else goes to the service. HEAD is handled as GET;
  // the HTTP layer omits its body.
  api::Response handle(const api::Request& request) const;

  // /health/ready returns 503 from now on, so that a proxy sends its requests elsewhere.
  void begin_shutdown() { ready_ = false; }

 private:
  api::Response answer_own_path(const api::Request& request) const;
  api::Response answer_other_path(const api::Request& request) const;

  const api::Service& service_;
  const Metrics& metrics_;
  const PageAccess pages_;
  const ReadGauges read_gauges_;
  std::atomic<bool> ready_{true};
};

}  // namespace selenograph::server
