// `selenograph serve`.
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstdio>
#include <thread>

#include "api/metadata.h"
#include "server/commands.h"
#include "server/front.h"
#include "server/heap_trim.h"
#include "server/http_server.h"
#include "server/shutdown_signals.h"
#include "server/start.h"
#include "server/trial.h"

namespace selenograph::server {
namespace {

HttpOptions http_options(const ServeSettings& s) {
  return {.host = s.host,
          .port = s.port,
          .max_connections = s.max_connections,
          .max_body_bytes = s.limits.max_body_bytes,
          .idle_timeout = milliseconds(s.idle_timeout_s),
          .receive_timeout = milliseconds(s.receive_timeout_s)};
}

// A tenth of the budgets for terrain and acceleration structures.
std::size_t heap_slack_bytes(const TerrainSettings& s) { return ((s.cache_mb + s.scene_mb) << 20) / 10; }

int places_in_work(const ServeSettings& s) {
  return s.max_frames > 0 ? s.max_frames : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

void note(Metrics& metrics, const AccessRecord& e) {
  const std::string_view route = route_label(e.path);
  metrics.count_answer(route, method_label(e.method), e.status, e.seconds, e.bytes);
  if (!e.error_code.empty()) metrics.count_error(e.error_code);
  const bool probe = route.substr(0, 8) == "/health/" || route == "/metrics";
  spdlog::log(probe ? spdlog::level::debug : spdlog::level::info, "{} {} {} {:.1f} ms {} B {}",
              e.method.empty() ? "-" : e.method, e.target.empty() ? "-" : e.target.substr(0, 200), e.status,
              e.seconds * 1000.0, e.bytes, e.error_code);
}

// What runs is finished; health and metrics answer until then.
void finish(Front& front, Admission& admission, HttpServer& server, std::chrono::milliseconds at_most) {
  front.begin_shutdown();
  spdlog::info("shutting down: {} in work, {} waiting", admission.in_work(), admission.waiting());
  if (!admission.wait_until_idle(Admission::Clock::now() + at_most))
    spdlog::warn("some requests outlived their deadline");
  server.stop();
}

}  // namespace

int serve(const ServeSettings& settings) {
  ShutdownSignals signals;
  set_up_log(settings.terrain.log_level);
  const auto renderer = make_renderer(settings.terrain);
  const HeapTrim trim([&] { return renderer->terrain().statistics().bytes + renderer->scene_bytes_in_use(); },
                      heap_slack_bytes(settings.terrain));
  const api::Limits& limits = settings.limits;
  const api::Service service(renderer, limits, settings.terrain.assets_dir, mesh_options(settings.terrain));
  Admission admission(places_in_work(settings), settings.max_waiting);
  Metrics metrics{std::string(api::software_version())};
  const HttpServer* http = nullptr;
  Front front(service, admission, metrics, [&](Gauges& gauges) {
    gauges.connections = http->connections();
    gauges.cache = renderer->terrain().statistics();
    gauges.terrain_warnings = renderer->terrain().warnings().size();
    gauges.scene_bytes = renderer->scene_bytes_in_use();
    gauges.cache_trouble = renderer->terrain().cache_trouble();
    gauges.mesh_bytes = service.mesh_bytes();
  });
  HttpServer server(
      http_options(settings), [&](const api::Request& request) { return front.handle(request); },
      [&](const AccessRecord& record) { note(metrics, record); });
  http = &server;
  signals.arm();
  std::thread accepting([&] { server.run(); });
  fmt::print("selenograph: listening on {}\n", server.url());
  std::fflush(stdout);

  bool good = true;
  settings.trial ? void(good = run_trial(server.url(), renderer->terrain().catalogue())) : signals.wait();
  finish(front, admission, server, limits.default_deadline + std::chrono::seconds(5));
  accepting.join();
  return good ? 0 : 1;
}

}  // namespace selenograph::server
