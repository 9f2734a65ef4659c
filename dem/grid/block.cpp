#include "dem/grid/block.h"

#include "dem/grid/degrees.h"

namespace selenograph::dem {

void fill_trigonometry(Block& block) {
  const BlockExtent& e = block.extent;
  const auto n = static_cast<std::size_t>(e.quads) + 1;
  for (auto* table : {&block.sin_lat, &block.cos_lat, &block.sin_lon, &block.cos_lon}) table->resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    // Convert ticks to degrees without rounding, so that all blocks have the same bits at a common position. Sines and
    // cosines of multiples of 90 degrees are exact.
    const auto [sin_lat, cos_lat] = sine_cosine_of_deg(lat_deg_of(e.lat0 + static_cast<Tick>(i) * e.lat_step));
    const auto [sin_lon, cos_lon] =
        sine_cosine_of_deg(lon_deg_of(wrap_lon(e.lon0 + static_cast<std::int64_t>(i) * e.lon_step)));
    block.sin_lat[i] = sin_lat;
    block.cos_lat[i] = cos_lat;
    block.sin_lon[i] = sin_lon;
    block.cos_lon[i] = cos_lon;
  }
}

std::shared_ptr<Block> empty_block(const BlockId& id, const BlockExtent& extent) {
  auto block = std::make_shared<Block>();
  block->id = id;
  block->extent = extent;
  fill_trigonometry(*block);
  return block;
}

}  // namespace selenograph::dem
