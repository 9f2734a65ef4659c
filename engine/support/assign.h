// Fills large arrays while the caller may be cancelled.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

#include "dem/base/stop_token.h"

namespace selenograph::engine {

// Values of results where nothing is hit.
inline constexpr float kNaN32 = std::numeric_limits<float>::quiet_NaN();
inline constexpr double kNaN64 = std::numeric_limits<double>::quiet_NaN();

// Assigns like std::vector::assign, in pieces, and checks `stop` between them: on virtual machines, first-touched
// memory takes up to 3 ms per megabyte. Throws Cancelled.
template <typename T>
void assign(std::vector<T>& array, std::size_t size, T value, const StopToken& stop) {
  constexpr std::size_t kPiece = std::size_t{1} << 20;
  array.clear();
  array.reserve(size);
  while (array.size() < size) {
    stop.check();
    array.resize(std::min(size, array.size() + kPiece), value);
  }
}

}  // namespace selenograph::engine
