// Dispatches requests between the HTTP server and the service: health, metrics, pages.
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "api/service.h"
#include "server/service/metrics.h"
#include "server/service/pages.h"

namespace selenograph::server {

// Paths that are answered whatever else the service does.
inline const std::vector<std::string> kProbePaths{"/health/live", "/health/ready", "/metrics"};

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
