// Pool of a catalogue's open files.
#pragma once

#include <algorithm>
#include <list>
#include <memory>
#include <mutex>
#include <utility>

#include "dem/base/error.h"
#include "dem/catalogue/catalogue.h"
#include "dem/gdal/raster.h"

namespace selenograph::dem {

// Number of files that stay open while no thread uses them. It suffices for the tiles of one chunk and its neighbours:
// 4 x 4 degrees of 1-degree tiles. It is small against the limit of 1024 descriptors.
inline constexpr std::size_t kIdleFiles = 32;

// Lends each open file to one thread at a time. Beyond kIdleFiles idle ones, the least recently returned file is
// closed.
class RasterPool {
 public:
  explicit RasterPool(const Catalogue& catalogue) : catalogue_(catalogue) {}

  // Calls use(raster), which fails when the file has changed. A file that was only touched, or is restored, is
  // reopened; reopening fails if it differs from the catalogue.
  template <typename Use>
  void with(int source, Use&& use) {
    constexpr int kAttempts = 3;
    std::unique_ptr<Raster> raster = take(source);
    for (int attempt = 1;; ++attempt) {
      if (!raster) raster = std::make_unique<Raster>(catalogue_.rasters()[static_cast<std::size_t>(source)]);
      try {
        use(*raster);
        break;
      } catch (const DataError&) {  // do not return a failed file to the pool
        if (attempt == kAttempts || raster->current()) throw;
        raster.reset();
      }
    }
    std::lock_guard lock(mutex_);
    idle_.emplace_front(source, std::move(raster));
    if (idle_.size() > kIdleFiles) idle_.pop_back();
  }

 private:
  std::unique_ptr<Raster> take(int source) {
    std::lock_guard lock(mutex_);
    const auto found = std::find_if(idle_.begin(), idle_.end(), [&](const auto& e) { return e.first == source; });
    if (found == idle_.end()) return nullptr;
    std::unique_ptr<Raster> raster = std::move(found->second);
    idle_.erase(found);
    return raster;
  }

  const Catalogue& catalogue_;
  std::mutex mutex_;
  std::list<std::pair<int, std::unique_ptr<Raster>>> idle_;
};

}  // namespace selenograph::dem
