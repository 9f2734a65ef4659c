// Progress of a campaign on stderr: one line that is rewritten on a terminal, otherwise a line per minute.
#pragma once

#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>

namespace selenograph::server {

// Thread-safe.
class CampaignProgress {
 public:
  explicit CampaignProgress(std::size_t frames);
  ~CampaignProgress();
  // Counts a finished line, and shows the progress when its interval has passed.
  void step(const std::string& name);

 private:
  using Clock = std::chrono::steady_clock;
  void show(const std::string& name);
  const bool terminal_;
  const std::size_t frames_;
  std::mutex mutex_;
  const Clock::time_point start_ = Clock::now();
  Clock::time_point shown_ = start_;
  std::size_t done_ = 0;
  bool line_open_ = false;
};

}  // namespace selenograph::server
