// What a request meets between the socket and the service: health, metrics, admission.
#pragma once

#include <atomic>
#include <functional>
#include <memory>

#include "api/service.h"
#include "server/http/connection.h"
#include "server/service/admission.h"
#include "server/service/metrics.h"
#include "server/service/pages.h"

namespace selenograph::server {

class Front {
 public:
  using ReadGauges = std::function<void(Gauges&)>;  // fills what only the owner knows: terrain, scenes, connections

  Front(const api::Service& service, Admission& admission, const Metrics& metrics, PageAccess pages,
        ReadGauges read_gauges);

  // /health/live, /health/ready and /metrics never queue, and are all that a reserved connection gets. Calls that cost
  // time need a place from admission; all others go straight to the service. HEAD is GET whose body the HTTP layer
  // leaves out. What there is no memory for is api::out_of_memory().
  // `queued` is given the time that the request waited for its place.
  api::Response handle(const api::Request& request, const Peer& peer,
                       Admission::Clock::duration& queued) const noexcept;

  // From now on /health/ready says no: a proxy sends its requests elsewhere. Those that come are answered.
  void begin_drain() { ready_ = false; }
  // From now on: not ready, and no new work is taken.
  void begin_shutdown();

 private:
  api::Response own(const api::Request& request) const;
  api::Response for_others(const api::Request& request, const Peer& peer, Admission::Clock::duration& queued) const;
  api::Response admitted(const api::Request& request, const Peer& peer, Admission::Clock::duration& queued) const;
  api::Response metrics_answer() const;

  const api::Service& service_;
  Admission& admission_;
  const Metrics& metrics_;
  const PageAccess pages_;
  const ReadGauges read_gauges_;
  std::atomic<bool> ready_{true};
};

}  // namespace selenograph::server
