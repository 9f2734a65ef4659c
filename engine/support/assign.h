// Large arrays, filled while somebody may give up waiting for them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "dem/support/stop_token.h"

namespace selenograph::engine {

// As std::vector's assign, in pieces, between which `stop` is looked at: memory that the system has not given before
// takes up to 3 ms a megabyte on virtual machines. Throws Cancelled.
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
