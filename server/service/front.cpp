#include "server/service/front.h"

#include <fmt/format.h>

#include <utility>

#include "api/message/problem.h"

namespace selenograph::server {
namespace {

using Clock = Admission::Clock;

// Returns true for the paths that never queue, and that no endpoint of the service answers.
bool is_own_path(const std::string& path) {
  return path == "/metrics" || path == "/health/live" || path == "/health/ready";
}

api::Response text_answer(int status, std::string body, std::string content_type = "text/plain; charset=utf-8") {
  api::Response answer;
  answer.status = status;
  answer.content_type = std::move(content_type);
  answer.headers = {{"Cache-Control", "no-store"}};
  answer.body = std::move(body);
  return answer;
}

// Returns the problem of a method other than GET and HEAD.
api::Response get_only() {
  api::Response answer = api::problem("method_not_allowed", "this path supports only GET");
  answer.headers.emplace_back("Allow", "GET, HEAD");
  return answer;
}

// An invalid time limit counts as the default: the service refuses it later.
Clock::time_point deadline_of(const api::Request& request, const api::Limits& limits) {
  return request.received + api::time_limit(request, limits).value_or(limits.default_deadline);
}

}  // namespace

Front::Front(const api::Service& service, Admission& admission, const Metrics& metrics, PageAccess pages,
             ReadGauges read_gauges)
    : service_(service),
      admission_(admission),
      metrics_(metrics),
      pages_(pages),
      read_gauges_(std::move(read_gauges)) {}

void Front::begin_shutdown() {
  ready_ = false;
  admission_.close();
}

api::Response Front::handle(const api::Request& request, const Peer& peer, Clock::duration& queued) const noexcept {
  return api::answer_or_problem(request, [&] {
    return is_own_path(request.path) ? answer_own_path(request) : answer_other_path(request, peer, queued);
  });
}

api::Response Front::answer_other_path(const api::Request& request, const Peer& peer, Clock::duration& queued) const {
  if (request.method == "HEAD") {
    api::Request get = request;
    get.method = "GET";
    return answer_other_path(get, peer, queued);
  }
  if (auto page = page_for(request, peer, pages_)) return request.method == "GET" ? std::move(*page) : get_only();
  return api::Service::needs_admission(request) ? handle_admitted(request, peer, queued) : service_.handle(request);
}

api::Response Front::answer_own_path(const api::Request& request) const {
  if (request.method != "GET" && request.method != "HEAD") return get_only();
  if (request.path == "/metrics") return metrics_answer();
  if (request.path == "/health/live") return text_answer(200, "ok\n");
  if (!ready_) return text_answer(503, "shutting down\n");
  Gauges gauges;
  read_gauges_(gauges);
  api::Response answer =
      text_answer(200, gauges.cache_trouble.empty() ? "ok\n" : fmt::format("ok\n{}\n", gauges.cache_trouble));
  answer.headers.emplace_back("Selenograph-Build", build_id());
  return answer;
}

api::Response Front::metrics_answer() const {
  Gauges gauges;
  gauges.ready = ready_;
  gauges.frames_in_work = admission_.in_work();
  gauges.frames_waiting = admission_.waiting();
  gauges.max_in_work = admission_.max_in_work();
  gauges.max_waiting = admission_.max_waiting();
  read_gauges_(gauges);
  return text_answer(200, metrics_.exposition(gauges), "text/plain; version=0.0.4; charset=utf-8");
}

api::Response Front::handle_admitted(const api::Request& request, const Peer& peer, Clock::duration& queued) const {
  const auto arrived = Clock::now();
  const Admission::Entry entry =
      admission_.enter(peer.client, deadline_of(request, service_.limits()), request.abandoned);
  queued = Clock::now() - arrived;
  switch (entry.outcome) {
    case Admission::Outcome::full:
      return api::retry_problem("busy", "server at capacity: all slots and queue places are taken",
                                entry.retry_after_s);
    case Admission::Outcome::closing:
      return api::retry_problem("shutting_down", "the service is about to stop", entry.retry_after_s);
    case Admission::Outcome::expired:
      return api::problem("deadline_exceeded", "timed out in the queue");
    case Admission::Outcome::abandoned:
      return api::problem("client_gone", "the client closed its connection");
    case Admission::Outcome::admitted:
      break;
  }
  api::Response answer = service_.handle(request);
  if (!answer.stages.empty())
    answer.stages.insert(answer.stages.begin(), {"queue", std::chrono::duration<double, std::milli>(queued).count()});
  if (answer.error_code == "busy")  // no memory became free for it
    answer.headers.emplace_back("Retry-After", std::to_string(admission_.retry_after_s()));
  return answer;
}

}  // namespace selenograph::server
