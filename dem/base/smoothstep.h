// The smooth step from 0 to 1.
#pragma once

#include <algorithm>

namespace selenograph::dem {

// Returns 0 up to t = 0, 1 from t = 1 on, and the cubic without slope at both ends between them.
template <typename Float>
Float smoothstep(Float t) {
  t = std::clamp(t, Float(0), Float(1));
  return t * t * (3 - 2 * t);
}

}  // namespace selenograph::dem
