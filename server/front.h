// What a request meets between the socket and the service: health, metrics, admission.
#pragma once

#include <atomic>
#include <functional>
#include <memory>

#include "api/service.h"
#include "server/admission.h"
#include "server/metrics.h"

namespace selenograph::server {

class Front {
 public:
  using ReadGauges = std::function<void(Gauges&)>;  // fills what only the owner knows: terrain, scenes, connections

  Front(const api::Service& service, Admission& admission, const Metrics& metrics, ReadGauges read_gauges);

  // /health/live, /health/ready and /metrics never queue. Calls that cost render time need a place from admission; all
  // others go straight to the service. HEAD is GET whose body the HTTP layer leaves out.
  api::Response handle(const api::Request& request) const;

  // From now on: not ready, and no new work is taken.
  void begin_shutdown();

 private:
  api::Response own(const api::Request& request) const;
  api::Response admitted(const api::Request& request) const;
  api::Response metrics_answer() const;
  api::Response refused(const std::string& code, const std::string& detail) const;

  const api::Service& service_;
  Admission& admission_;
  const Metrics& metrics_;
  const ReadGauges read_gauges_;
  std::atomic<bool> ready_{true};
};

}  // namespace selenograph::server
