#include "dem/grid/block.h"

#include <GeographicLib/Math.hpp>

namespace selenograph::dem {

void fill_trigonometry(Block& block) {
  using GeographicLib::Math;
  const BlockExtent& e = block.extent;
  const auto n = static_cast<std::size_t>(e.quads) + 1;
  for (auto* table : {&block.sin_lat, &block.cos_lat, &block.sin_lon, &block.cos_lon}) table->resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    // sincosd is exact at multiples of 90 degrees, and ticks make the same place the same number in every block.
    Math::sincosd(lat_deg_of(e.lat0 + static_cast<std::int32_t>(i) * e.lat_step), block.sin_lat[i], block.cos_lat[i]);
    Math::sincosd(lon_deg_of(wrap_lon(e.lon0 + static_cast<std::int64_t>(i) * e.lon_step)), block.sin_lon[i],
                  block.cos_lon[i]);
  }
}

}  // namespace selenograph::dem
