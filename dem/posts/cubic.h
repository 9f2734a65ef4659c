// Cubic interpolation of posts.
#pragma once

#include <array>

namespace selenograph::dem {

// Returns the Catmull-Rom weights (Catmull & Rom 1974, tension 1/2) of four posts, at fraction t between the middle
// two.
inline std::array<double, 4> cubic_weights(double t) {
  return {t * (-0.5 + t * (1.0 - 0.5 * t)), 1.0 + t * t * (-2.5 + 1.5 * t), t * (0.5 + t * (2.0 - 1.5 * t)),
          t * t * (-0.5 + 0.5 * t)};
}

}  // namespace selenograph::dem
