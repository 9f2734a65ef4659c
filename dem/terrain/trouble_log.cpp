#include "dem/terrain/trouble_log.h"

#include <fmt/format.h>

#include <system_error>
#include <utility>

namespace selenograph::dem {

TroubleLog::TroubleLog(std::function<void(const std::string&)> log, std::string cache_dir)
    : log_(std::move(log)), cache_dir_(std::move(cache_dir)) {}

void TroubleLog::log(const std::string& text) const {
  if (log_) log_(text);
}

void TroubleLog::warn(const std::string& file, const std::string& text) {
  {
    std::lock_guard lock(mutex_);
    if (!warnings_.emplace(file, text).second) return;
  }
  log(text);
}

void TroubleLog::cache_failed(const char* done, const SystemFault& fault) {
  const std::string trouble = fmt::format("pyramids are kept in memory only: {} cannot be {}: {}", cache_dir_, done,
                                          std::generic_category().message(fault.code()));
  {
    std::lock_guard lock(mutex_);
    if (std::exchange(cache_trouble_, trouble) == trouble) return;
  }
  log(trouble);
}

void TroubleLog::cache_works() {
  {
    std::lock_guard lock(mutex_);
    if (std::exchange(cache_trouble_, {}).empty()) return;
  }
  log(fmt::format("pyramids are written to {} again", cache_dir_));
}

std::vector<std::string> TroubleLog::warnings() const {
  std::lock_guard lock(mutex_);
  std::vector<std::string> texts;
  for (const auto& [file, text] : warnings_) texts.push_back(text);
  return texts;
}

std::string TroubleLog::cache_trouble() const {
  std::lock_guard lock(mutex_);
  return cache_trouble_;
}

}  // namespace selenograph::dem
