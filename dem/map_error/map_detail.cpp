#include "dem/map_error/map_detail.h"

#include <algorithm>
#include <cmath>

#include "dem/base/hash.h"

namespace selenograph::dem {

std::shared_ptr<const Detail> detail_of_map(const std::shared_ptr<const Detail>& detail, const MapError& error) {
  if (!detail || error.missing_craters_below_m <= 0) return detail;
  DetailPreset preset = detail->preset();
  const double smallest_m = std::exp2(std::ceil(std::log2(error.missing_craters_below_m)));
  CraterLaw& craters = preset.craters;
  craters.smallest_m = std::min(std::max(craters.smallest_m, smallest_m), craters.largest_m);
  preset.rocks = {};
  preset.clods = {};
  // Blocks with detail are stored in the cache folder by the fingerprint.
  preset.fingerprint = hash_of(&craters.smallest_m, sizeof craters.smallest_m, preset.fingerprint);
  return std::make_shared<const Detail>(preset);
}

}  // namespace selenograph::dem
