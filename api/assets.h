// Files that requests name: what the operator put into the assets folder, one subfolder per kind.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "engine/atmosphere.h"

namespace selenograph::api {

// const means safe to call concurrently. A file that changed is read again.
class Assets {
 public:
  // Empty: there are none.
  explicit Assets(std::string folder = {}) : folder_(std::move(folder)) {}

  // atmospheres/NAME.csv, as engine::Atmosphere::read says; null when there is no such file. Throws DataError naming
  // the file when it can't be used.
  std::shared_ptr<const engine::Atmosphere> atmosphere(std::string_view name) const;

  // Of the files of a kind ("atmospheres"), without their extension; sorted.
  std::vector<std::string> names(std::string_view kind) const;

  // Of what an atmosphere was read from, so that a frame's ETag changes with it; 0 for null.
  static std::uint64_t fingerprint(const engine::Atmosphere* atmosphere);

 private:
  struct Stamp {
    std::int64_t modified_ns;
    std::uintmax_t bytes;
    bool operator==(const Stamp&) const = default;
  };
  struct Read {
    Stamp stamp;
    std::shared_ptr<const engine::Atmosphere> atmosphere;
  };

  std::string folder_;
  mutable std::mutex mutex_;
  mutable std::map<std::string, Read, std::less<>> atmospheres_;
};

}  // namespace selenograph::api
