// Messages about files for the operator, each once.
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "dem/base/error.h"

namespace selenograph::dem {

// Thread-safe.
class TroubleLog {
 public:
  // `log` may be empty. `cache_dir`: the cache folder, named in messages.
  TroubleLog(std::function<void(const std::string&)> log, std::string cache_dir);

  void log(const std::string& text) const;
  // Reports the first text about each file only.
  void warn(const std::string& file, const std::string& text);
  // Returns one warning per file, sorted by file name.
  std::vector<std::string> warnings() const;

  // Reports that the cache folder cannot be read or written (`done`: "read" or "written"), or can be written again.
  void cache_failed(const char* done, const SystemFault& fault);
  void cache_works();
  // Returns the last failure of the cache folder; empty: it works.
  std::string cache_trouble() const;

 private:
  const std::function<void(const std::string&)> log_;
  const std::string cache_dir_;
  mutable std::mutex mutex_;
  std::map<std::string, std::string> warnings_;  // per file
  std::string cache_trouble_;
};

}  // namespace selenograph::dem
