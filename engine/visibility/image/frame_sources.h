// Numbers the DEM files that a frame sees, for its `source` product.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "dem/files/raster_info.h"
#include "dem/grid/block.h"
#include "engine/frame/report.h"

namespace selenograph::engine {

// Returns the entry of a file in the list of sources.
SourceTile source_tile(const dem::RasterInfo& info);

// Pixels are drawn in parallel and see sources in any order: each new source gets the next number, which `resolve`
// replaces by its index in the order of the catalogue. A catalogue may hold more sources than 16 bits can number; a
// frame may not see that many.
class FrameSources {
 public:
  static constexpr std::uint16_t kNone = 65535;  // value of pixels without a source

  explicit FrameSources(std::size_t catalogue_size);

  // Returns the number of a source that a pixel sees. Thread-safe.
  std::uint32_t number(dem::SourceIndex source) {
    const Page* page = pages_[source / kPage].load(std::memory_order_acquire);
    const std::uint32_t number_plus_one = page ? (*page)[source % kPage].load(std::memory_order_relaxed) : 0;
    return (number_plus_one != 0 ? number_plus_one : add(source)) - 1;
  }
  // Returns number() as a value of the product. Throws TooMuchTerrain if it does not fit into 16 bits.
  std::uint16_t product_number(dem::SourceIndex source);

  // Returns the sources seen, ascending, and replaces the numbers in the product by indices into them. Call after all
  // pixels are drawn.
  std::vector<dem::SourceIndex> resolve(std::vector<std::uint16_t>& product) const;

 private:
  // Numbers of neighbouring catalogue entries share a page that is made on first use: the cost of a frame must not grow
  // with the catalogue.
  static constexpr std::size_t kPage = 256;
  using Page = std::array<std::atomic<std::uint32_t>, kPage>;  // number plus one; 0: not seen yet

  std::uint32_t add(dem::SourceIndex source);

  std::unique_ptr<std::atomic<Page*>[]> pages_;  // index: catalogue index / kPage
  std::mutex mutex_;
  std::vector<std::unique_ptr<Page>> owned_pages_;  // owns the pages in pages_
  std::vector<dem::SourceIndex> sources_;           // sources seen, by number
};

}  // namespace selenograph::engine
