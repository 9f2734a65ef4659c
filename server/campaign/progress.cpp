#include "server/campaign/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>

namespace selenograph::server {
namespace {

std::string duration(double seconds) {
  const auto rounded_s = std::llround(seconds);
  if (rounded_s < 60) return fmt::format("{} s", rounded_s);
  if (rounded_s < 3600) return fmt::format("{} min {} s", rounded_s / 60, rounded_s % 60);
  return fmt::format("{} h {} min", rounded_s / 3600, rounded_s % 3600 / 60);
}

}  // namespace

CampaignProgress::CampaignProgress(std::size_t frames) : terminal_(::isatty(STDERR_FILENO) == 1), frames_(frames) {}

CampaignProgress::~CampaignProgress() {
  if (line_open_) fmt::print(stderr, "\n");
}

void CampaignProgress::step(const std::string& name) {
  const std::lock_guard lock(mutex_);
  ++done_;
  const Clock::duration interval =
      terminal_ ? Clock::duration(std::chrono::milliseconds(100)) : std::chrono::minutes(1);
  if (Clock::now() - shown_ >= interval || (terminal_ && done_ == frames_)) show(name);
}

void CampaignProgress::show(const std::string& name) {
  shown_ = Clock::now();
  const std::chrono::duration<double> spent = shown_ - start_;
  const double rate = static_cast<double>(done_) / spent.count();
  fmt::print(stderr, "{}{} of {} frames, {:.1f} %, {:.2f} per second, {} left  {}{}", terminal_ ? "\r\033[K" : "",
             done_, frames_, 100.0 * static_cast<double>(done_) / static_cast<double>(frames_), rate,
             duration(static_cast<double>(frames_ - done_) / rate), name, terminal_ ? "" : "\n");
  line_open_ = terminal_;
}

}  // namespace selenograph::server
