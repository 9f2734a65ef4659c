// Dispatches requests between the HTTP server and the service: health, metrics, admission.
#pragma once

#include <atomic>
#include <functional>
#include <memory>

#include "api/service.h"
#include "server/http/caller.h"
#include "server/service/admission.h"
#include "server/service/metrics.h"
#include "server/service/pages.h"

namespace selenograph::server {

class Front {
 public:
  using ReadGauges = std::function<void(Gauges&)>;  // fills gauges known to the owner: terrain, scenes, connections

  Front(const api::Service& service, Admission& admission, const Metrics& metrics, PageAccess pages,
        ReadGauges read_gauges);

  // /health/live, /health/ready and /metrics never queue. Expensive calls need a slot from admission; all others go
  // straight to the service. HEAD is handled as GET; the HTTP layer omits its body. Without memory for a response the
  // result is api::out_of_memory(). `queued` receives the time that the request waited for its slot.
  api::Response handle(const api::Request& request, const Peer& peer,
                       Admission::Clock::duration& queued) const noexcept;

  // /health/ready returns 503 from now on, so that a proxy sends its requests elsewhere. Requests are still answered.
  void begin_drain() { ready_ = false; }
  // Not ready from now on, and no new work is accepted.
  void begin_shutdown();

 private:
  api::Response answer_own_path(const api::Request& request) const;
  api::Response answer_other_path(const api::Request& request, const Peer& peer,
                                  Admission::Clock::duration& queued) const;
  api::Response handle_admitted(const api::Request& request, const Peer& peer,
                                Admission::Clock::duration& queued) const;
  api::Response metrics_answer() const;

  const api::Service& service_;
  Admission& admission_;
  const Metrics& metrics_;
  const PageAccess pages_;
  const ReadGauges read_gauges_;
  std::atomic<bool> ready_{true};
};

}  // namespace selenograph::server
