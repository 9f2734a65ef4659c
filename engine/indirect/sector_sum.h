// Sums over all sectors in an order that neither the vector width nor Highway's version changes. Highway 1.0 and 1.2
// add the lanes of a vector in different orders, which alters last bits.
#pragma once

#include "engine/indirect/slope_light.h"

namespace selenograph::engine {

inline float sum_of_sectors(const float values[kSectors]) {
  static_assert(kSectors == 8);
  const float four[] = {values[0] + values[4], values[1] + values[5], values[2] + values[6], values[3] + values[7]};
  return (four[0] + four[2]) + (four[1] + four[3]);
}

}  // namespace selenograph::engine
