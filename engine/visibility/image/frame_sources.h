// The catalogue's files that a frame sees, and their numbers in its `source` product.
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

// What the list of sources says of one.
SourceTile source_tile(const dem::RasterInfo& info);

// Pixels are drawn at once and meet sources in any order: each new one gets the next number, which `settle` replaces by
// its place in the catalogue's order. A catalogue may hold more sources than 16 bits can tell apart; a frame may not
// see that many.
class FrameSources {
 public:
  static constexpr std::uint16_t kNone = 65535;  // in the product

  explicit FrameSources(std::size_t catalogue_size);

  // Of a source that a pixel sees. Safe to call concurrently.
  std::uint32_t number(dem::SourceIndex source) {
    const Page* page = pages_[source / kPage].load(std::memory_order_acquire);
    const std::uint32_t known = page ? (*page)[source % kPage].load(std::memory_order_relaxed) : 0;
    return (known != 0 ? known : add(source)) - 1;
  }
  // The same for the product. Throws TooMuchTerrain when it doesn't fit into that.
  std::uint16_t product_number(dem::SourceIndex source);

  // Once all pixels are drawn: what was seen, ascending. The product's numbers become indices into that.
  std::vector<dem::SourceIndex> settle(std::vector<std::uint16_t>& product) const;

 private:
  // A frame must not cost more because the catalogue holds all of the Moon: numbers of neighbours in the catalogue
  // share a page, made when the first of them is seen.
  static constexpr std::size_t kPage = 256;
  using Page = std::array<std::atomic<std::uint32_t>, kPage>;  // the number plus one; 0: not seen yet

  std::uint32_t add(dem::SourceIndex source);

  std::unique_ptr<std::atomic<Page*>[]> pages_;  // by catalogue index / kPage
  std::mutex mutex_;
  std::vector<std::unique_ptr<Page>> made_;  // what pages_ points at
  std::vector<dem::SourceIndex> seen_;       // by number
};

}  // namespace selenograph::engine
