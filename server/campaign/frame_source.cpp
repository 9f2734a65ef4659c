#include "server/campaign/frame_source.h"

#include <chrono>
#include <stdexcept>
#include <thread>

#include "api/encode/negotiate.h"
#include "api/message/json_text.h"

namespace selenograph::server {

std::string Answer::header(std::string_view name) const {
  for (const auto& [header, value] : response.headers)
    if (header == name) return value;
  return {};
}

FrameSource::FrameSource(const Manifest& manifest, const api::Service& service, const std::string& format,
                         std::atomic<bool>& stop)
    : manifest_(manifest), service_(service), stop_(stop) {
  for (const api::Representation& r : api::representations())
    if (r.extension == format) media_type_ = r.media_type;
  if (media_type_.empty()) throw std::runtime_error(format + ": is not a format of frames");
}

Outcome FrameSource::outcome_of(int status) const {
  if (status == 200) return Outcome::frame;
  if (status == 304) return Outcome::not_modified;
  if (stop_) return Outcome::cancelled;
  return status < 500 ? Outcome::refused : Outcome::failed;
}

Answer FrameSource::answer(const ManifestLine& line, const std::string& if_none_match) const {
  constexpr int kMaxTries = 3;
  api::Request request;
  request.method = "POST";
  request.path = "/v1/frames";
  request.headers = {{"accept", media_type_}, {"content-type", "application/json"}};
  if (!if_none_match.empty()) request.headers.emplace("if-none-match", if_none_match);
  request.body = api::json_text(manifest_.request(line));
  request.abandoned = &stop_;
  Answer answer;
  for (int i = 0; i < kMaxTries && !stop_; ++i) {
    request.received = std::chrono::steady_clock::now();
    answer.response = service_.handle(request);
    answer.outcome = outcome_of(answer.response.status);
    // 503: other requests hold the memory that this one needs. Try again after a second, which `stop_` cuts short.
    if (answer.response.status != 503) return answer;
    for (int wait = 0; wait < 20 && !stop_; ++wait) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  if (stop_) answer.outcome = Outcome::cancelled;
  return answer;
}

}  // namespace selenograph::server
