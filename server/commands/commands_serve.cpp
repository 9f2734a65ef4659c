// `selenograph serve`: from the settings to a running service, and to its orderly shutdown.
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <stdexcept>
#include <thread>
#include <utility>

#include "api/answers/metadata.h"
#include "api/message/version.h"
#include "engine/support/heap.h"
#include "server/commands/commands.h"
#include "server/commands/start.h"
#include "server/commands/trial.h"
#include "server/http/http_server.h"
#include "server/service/front.h"
#include "server/service/heap_trim.h"
#include "server/service/log.h"
#include "server/service/memory_plan.h"
#include "server/service/open_files.h"
#include "server/service/shutdown_signals.h"

namespace selenograph::server {
namespace {

HttpOptions http_options(const ServeSettings& s, std::shared_ptr<api::MemoryBudget> bodies,
                         std::function<int()> retry_after_s) {
  return {.host = s.host,
          .port = s.port,
          .max_connections = s.max_connections,
          .max_body_bytes = s.limits.max_body_bytes,
          .bodies = std::move(bodies),
          .idle_timeout = milliseconds(s.idle_timeout_s),
          .receive_timeout = milliseconds(s.receive_timeout_s),
          .send_pace = {.bytes_per_s = s.send_kb_per_s * 1024},
          .retry_after_s = std::move(retry_after_s),
          .trusted_proxies = s.trusted_proxy,
          .allowed_hosts = s.allowed_host};
}

// Resident memory of the idle program, its libraries and threads (tests/service/memory_test.py).
constexpr std::size_t kIdleBytes = std::size_t{160} << 20;

std::size_t budgets_bytes(const MemoryParts& parts) { return (parts.cache_mb + parts.scene_mb) << 20; }

// Limits resident memory to the budgets of terrain and scenes plus a twentieth, for the program itself and for heap
// fragments. With small budgets the idle program would take most of that, so the limit is then its memory plus 70 % of
// the budgets. Requests of up to an eighth of the budgets are included; larger ones are added.
HeapTrim::Plan heap_plan(const MemoryParts& parts, bool keep_free, const engine::Renderer& renderer,
                         std::function<std::size_t()> requests_bytes) {
  const std::size_t terrain_bytes = parts.cache_mb << 20;
  const std::size_t budgets = budgets_bytes(parts);
  const auto max_resident_bytes = [budgets, requests_bytes = std::move(requests_bytes)] {
    const std::size_t requests = requests_bytes();
    return std::max(budgets + budgets / 20, kIdleBytes + budgets / 10 * 7) + (requests > budgets / 8 ? requests : 0);
  };
  const auto keep_less = [&renderer](std::size_t bytes) {
    renderer.terrain().keep_less(bytes);
    renderer.keep_less(bytes);
  };
  return {.slack_bytes = budgets / 20,
          .max_cache_cut_bytes = terrain_bytes / 2,
          .keep_free = keep_free,
          .max_resident_bytes = max_resident_bytes,
          .keep_less = keep_less};
}

// Touches as much memory as the budgets exceed the process's resident memory.
void pretouch(const MemoryParts& parts) {
  const std::size_t bytes = budgets_bytes(parts) - std::min(budgets_bytes(parts), resident_bytes());
  if (!engine::touch_memory(bytes)) spdlog::warn("--pretouch: the system could not provide {} MiB", bytes >> 20);
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

// Gives a proxy the time to notice that this node is not ready, before the node refuses any request.
void drain(Front& front, std::chrono::milliseconds time) {
  front.begin_drain();
  if (time.count() == 0) return;
  spdlog::info("drain began: not ready, requests are refused in {:g} s", std::chrono::duration<double>(time).count());
  std::this_thread::sleep_for(time);
}

// Ends the service after a signal:
//
//   signal          --drain-s                       cut         --shutdown-s
//   |  not ready, but  |  new requests get 503, active  |  exit as soon  |
//   |  all is served   |  and queued ones finish        |  as possible   |  exit status 1
//
// Finishes active and queued requests; health and metrics are answered until then. Shortly before the time limit it
// cuts the remaining connections, which cancels their requests.
void finish(Front& front, Admission& admission, HttpServer& server, const dem::PyramidTerrain& terrain,
            std::chrono::milliseconds time_limit) {
  const auto cut = Admission::Clock::now() + time_limit - std::min(time_limit / 5, std::chrono::milliseconds(1000));
  front.begin_shutdown();
  spdlog::info("shutdown began: {} requests in work, {} waiting", admission.in_work(), admission.waiting());
  const bool is_idle = admission.wait_until_idle(cut);
  server.stop();
  if (is_idle && server.wait_until_done(cut)) return;
  spdlog::warn("cut {} connections: {} requests in work, {} waiting", server.connections(), admission.in_work(),
               admission.waiting());
  server.cut();
  terrain.stop_building();
}

// Reads the renderer's, the service's and the budgets' values for /metrics and /health/ready.
void read_gauges(const engine::Renderer& renderer, const api::Service& service, const api::MemoryBudget& memory,
                 const api::MemoryBudget& bodies, Gauges& gauges) {
  gauges.cache = renderer.terrain().statistics();
  gauges.terrain_warnings = renderer.terrain().warnings().size();
  gauges.scene_bytes = renderer.scene_bytes_in_use();
  gauges.heap = engine::heap_statistics();
  gauges.preparation = renderer.preparation_statistics();
  gauges.cache_trouble = renderer.terrain().cache_trouble();
  gauges.mesh_bytes = service.mesh_bytes();
  gauges.request_memory_bytes = memory.in_use();
  gauges.request_memory_capacity_bytes = memory.capacity();
  gauges.body_bytes = bodies.in_use();
}

int run_service(const ServeSettings& settings, ShutdownSignals& signals, const AsyncLog& log) {
  if (settings.drain_s >= settings.shutdown_s)
    throw std::runtime_error(fmt::format("--drain-s {:g} must be less than --shutdown-s {:g}, of which it is a part",
                                         settings.drain_s, settings.shutdown_s));
  raise_open_files_limit(settings.max_connections);
  const MemoryParts parts = memory_parts(settings.terrain.memory);
  const MemoryPlan plan = plan_memory(parts);
  spdlog::info("memory: {} MiB, of which terrain {}, scenes {}, meshes {}, requests {}, bodies {}", parts.total_mb,
               parts.cache_mb, parts.scene_mb, parts.mesh_mb, plan.requests_bytes >> 20, plan.bodies_bytes >> 20);
  if (const std::size_t machine_mb = machine_memory_mb(); parts.total_mb > machine_mb)
    spdlog::warn("--memory-mb {} exceeds the {} MiB that this process may use", parts.total_mb, machine_mb);
  const auto renderer = make_renderer(settings.terrain);
  const auto memory = std::make_shared<api::MemoryBudget>(plan.requests_bytes);
  const auto bodies = std::make_shared<api::MemoryBudget>(plan.bodies_bytes);
  if (settings.pretouch) pretouch(parts);
  const HeapTrim trim(
      heap_plan(parts, settings.pretouch, *renderer, [&] { return memory->in_use() + bodies->in_use(); }));
  const api::Limits& limits = settings.limits;
  const api::Service service(renderer, limits, settings.terrain.assets_dir, mesh_options(settings.terrain), memory);
  Admission admission({.max_in_work = slots(settings), .max_waiting = settings.max_waiting});
  Metrics metrics{std::string(api::software_version())};
  const HttpServer* http = nullptr;  // set below: the front end is made first, and is asked for gauges only later
  Front front(service, admission, metrics, settings.page, [&](Gauges& gauges) {
    read_gauges(*renderer, service, *memory, *bodies, gauges);
    gauges.connections = http->connections();
    gauges.log_lines_dropped = log.dropped();
  });
  HttpServer server(
      http_options(settings, bodies, [&] { return admission.retry_after_s(); }),
      [&](const api::Request& request, const Peer& peer, Admission::Clock::duration& queued) {
        return front.handle(request, peer, queued);
      },
      [&](const AccessRecord& request) { record_access(metrics, log, request); });
  http = &server;
  const std::chrono::milliseconds time_limit = milliseconds(settings.shutdown_s);
  signals.arm(time_limit);
  std::thread accepting([&] { server.run(); });
  fmt::print("selenograph: listening on {}\n", server.url());
  std::fflush(stdout);

  bool is_good = true;
  if (settings.trial) {
    is_good = run_trial(server.url(), renderer->terrain().catalogue());
  } else {
    signals.wait();
    drain(front, milliseconds(settings.drain_s));
  }
  finish(front, admission, server, renderer->terrain(),
         settings.trial ? time_limit : time_limit - milliseconds(settings.drain_s));
  accepting.join();
  return is_good ? 0 : 1;
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
