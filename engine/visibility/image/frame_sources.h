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

// Entry of a file in the list of sources.
SourceTile source_tile(const dem::RasterInfo& info);

// Pixels are drawn in parallel and meet sources in any order: each new source gets the next number, which `settle`
// replaces by its place in the catalogue's order. A catalogue may hold more sources than 16 bits can distinguish; a
// frame may not see that many.
class FrameSources {
 public:
  static constexpr std::uint16_t kNone = 65535;  // value in the product

  explicit FrameSources(std::size_t catalogue_size);

  // Number of a source that a pixel sees. Thread-safe.
  std::uint32_t number(dem::SourceIndex source) {
    const Page* page = pages_[source / kPage].load(std::memory_order_acquire);
    const std::uint32_t known = page ? (*page)[source % kPage].load(std::memory_order_relaxed) : 0;
    return (known != 0 ? known : add(source)) - 1;
  }
  // The same as the product's value. Throws TooMuchTerrain when it does not fit into 16 bits.
  std::uint16_t product_number(dem::SourceIndex source);

  // Call after all pixels are drawn: returns the sources seen, ascending, and replaces the product's numbers by indices
  // into them.
  std::vector<dem::SourceIndex> settle(std::vector<std::uint16_t>& product) const;

 private:
  // The cost of a frame must not grow with the catalogue: numbers of neighbouring catalogue entries share a page that
  // is made on first use.
  static constexpr std::size_t kPage = 256;
  using Page = std::array<std::atomic<std::uint32_t>, kPage>;  // the number plus one; 0: not seen yet

  std::uint32_t add(dem::SourceIndex source);

  std::unique_ptr<std::atomic<Page*>[]> pages_;  // by catalogue index / kPage
  std::mutex mutex_;
  std::vector<std::unique_ptr<Page>> made_;  // owns the pages in pages_
  std::vector<dem::SourceIndex> seen_;       // by number
};

}  // namespace selenograph::engine
