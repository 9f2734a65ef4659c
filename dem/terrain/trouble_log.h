// What the operator is told about files, each thing once.
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "dem/support/error.h"

namespace selenograph::dem {

// Safe to call concurrently.
class TroubleLog {
 public:
  // `log` may be empty. `cache_dir`: where pyramids are kept.
  TroubleLog(std::function<void(const std::string&)> log, std::string cache_dir);

  void log(const std::string& text) const;
  // The first text about a file alone.
  void warn(const std::string& file, const std::string& text);
  // One for each file, in the order of their names.
  std::vector<std::string> warnings() const;

  // The cache folder can't be read or written (`done`: "read" or "written"), or can be written again.
  void cache_failed(const char* done, const SystemFault& fault);
  void cache_works();
  // Empty: there is none.
  std::string cache_trouble() const;

 private:
  const std::function<void(const std::string&)> log_;
  const std::string cache_dir_;
  mutable std::mutex mutex_;
  std::map<std::string, std::string> warnings_;  // by file
  std::string cache_trouble_;
};

}  // namespace selenograph::dem
