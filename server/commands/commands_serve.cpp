// `selenograph serve`: from the settings to a running service, and to its orderly shutdown.
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <thread>
#include <utility>

#include "api/answers/metadata.h"
#include "api/message/admission.h"
#include "api/message/version.h"
#include "engine/support/heap.h"
#include "server/commands/commands.h"
#include "server/commands/start.h"
#include "server/http/http_server.h"
#include "server/service/front.h"
#include "server/service/log.h"
#include "server/service/memory_plan.h"
#include "server/service/shutdown_signals.h"

namespace selenograph::server {
namespace {

// Time for a client to send its request, and to take its answer.
constexpr std::chrono::seconds kReceiveTime{20}, kAnswerTime{60};

HttpOptions http_options(const ServeSettings& s) {
  return {.host = s.host,
          .port = s.port,
          .max_connections = s.max_connections,
          .max_body_bytes = s.limits.max_body_bytes,
          .idle_time = milliseconds(s.idle_timeout_s),
          .receive_time = kReceiveTime,
          .answer_time = kAnswerTime,
          .reserved_paths = kProbePaths,
          .trusted_proxies = s.trusted_proxy,
          .allowed_hosts = s.allowed_host};
}

// Returns the number of requests that are processed at once.
int slots(const ServeSettings& s) {
  return s.max_frames > 0 ? s.max_frames : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

// Counts and logs a finished request; probes of health and metrics only at level debug.
void record_access(Metrics& metrics, const AsyncLog& log, const AccessRecord& request) {
  const std::string_view route = route_label(request.path);
  metrics.count_answer(route, method_label(request.method), request.status, request.seconds, request.bytes);
  if (!request.error_code.empty()) metrics.count_error(request.error_code);
  const bool is_probe = route.starts_with("/health/") || route == "/metrics";
  log.log_request(is_probe ? spdlog::level::debug : spdlog::level::info, request);
}

// Ends the service after a signal:
//
//   signal                                        cut         --shutdown-s
//   |  not ready, new requests get 503, active     |  exit as soon  |
//   |  and queued ones finish                      |  as possible   |  exit status 1
//
// Finishes active and queued requests; health and metrics are answered until then. Shortly before the time limit it
// cuts the remaining connections, which cancels their requests.
void finish(Front& front, api::Admission& admission, HttpServer& server, const dem::PyramidTerrain& terrain,
            std::chrono::milliseconds time_limit) {
  const auto cut = HttpServer::Clock::now() + time_limit - std::min(time_limit / 5, std::chrono::milliseconds(1000));
  front.begin_shutdown();
  admission.close();
  spdlog::info("shutdown began: {} requests in work, {} waiting", admission.in_work(), admission.waiting());
  admission.wait_until_idle(cut);
  if (server.stop(cut)) return;
  spdlog::warn("cut {} connections: {} requests in work, {} waiting", server.connections(), admission.in_work(),
               admission.waiting());
  terrain.stop_building();
}

// Reads the renderer's, the service's and the queue's values for /metrics and /health/ready.
void read_gauges(const engine::Renderer& renderer, const api::Service& service, const api::Admission& admission,
                 Gauges& gauges) {
  gauges.cache = renderer.terrain().statistics();
  gauges.terrain_warnings = renderer.terrain().warnings().size();
  gauges.scene_bytes = renderer.scene_bytes_in_use();
  gauges.heap = engine::heap_statistics();
  gauges.preparation = renderer.preparation_statistics();
  gauges.cache_trouble = renderer.terrain().cache_trouble();
  gauges.mesh_bytes = service.mesh_bytes();
  gauges.frames_in_work = admission.in_work();
  gauges.frames_waiting = admission.waiting();
  gauges.max_in_work = admission.limits().max_in_work;
  gauges.max_waiting = admission.limits().max_waiting;
  gauges.request_memory_bytes = admission.bytes_in_use();
  gauges.request_memory_capacity_bytes = admission.limits().max_bytes;
}

// Divides the memory, and logs the parts.
MemoryPlan logged_memory_plan(const MemorySettings& settings) {
  const MemoryPlan plan = plan_memory(settings);
  require_memory_for_requests(plan);
  spdlog::info("memory: {} MiB, of which terrain {}, scenes {}, meshes {}, requests {}", plan.total_mb, plan.cache_mb,
               plan.scene_mb, plan.mesh_mb, plan.requests_mb);
  if (const std::size_t machine_mb = machine_memory_mb(); plan.total_mb > machine_mb)
    spdlog::warn("--memory-mb {} exceeds the {} MiB that this process may use", plan.total_mb, machine_mb);
  return plan;
}

int run_service(const ServeSettings& settings, ShutdownSignals& signals, const AsyncLog& log) {
  const MemoryPlan plan = logged_memory_plan(settings.terrain.memory);
  const auto renderer = make_renderer(settings.terrain);
  const auto admission = std::make_shared<api::Admission>(api::AdmissionLimits{
      .max_in_work = slots(settings), .max_waiting = settings.max_waiting, .max_bytes = plan.requests_mb << 20});
  const api::Service service(renderer, settings.limits, settings.terrain.assets_dir, mesh_options(settings.terrain),
                             admission);
  Metrics metrics{std::string(api::software_version())};
  const HttpServer* http = nullptr;  // set below: the front end is made first, and is asked for gauges only later
  Front front(service, metrics, settings.page, [&](Gauges& gauges) {
    read_gauges(*renderer, service, *admission, gauges);
    gauges.connections = http->connections();
    gauges.log_lines_dropped = log.dropped();
  });
  const auto server = HttpServer::make(
      http_options(settings), [&](const api::Request& request) { return front.handle(request); },
      [&](const AccessRecord& request) { record_access(metrics, log, request); });
  http = server.get();
  const std::chrono::milliseconds time_limit = milliseconds(settings.shutdown_s);
  signals.arm(time_limit);
  std::thread accepting([&] { server->run(); });
  const bool is_ipv6 = settings.host.find(':') != std::string::npos;
  fmt::print("selenograph: listening on http://{}:{}\n", is_ipv6 ? '[' + settings.host + ']' : settings.host,
             server->port());
  std::fflush(stdout);
  signals.wait();
  finish(front, *admission, *server, renderer->terrain(), time_limit);
  accepting.join();
  return 0;
}

}  // namespace

int serve(const ServeSettings& settings) {
  ShutdownSignals signals;  // destroyed last: its time limit also covers the other destructors
  const AsyncLog log(settings.terrain.log_level, STDERR_FILENO, settings.log_format);
  try {
    return run_service(settings, signals, log);
  } catch (const std::exception& e) {
    // main() would print the error as plain text, which readers of a JSON log could not parse.
    if (settings.log_format != LogFormat::json) throw;
    spdlog::critical("{}", e.what());
    return 1;
  }
}

}  // namespace selenograph::server
