// Compares the products of two frames.
#pragma once

#include <cstring>
#include <tuple>

#include "engine/frame/products.h"

namespace selenograph::test {

// Returns true if both frames have the same products, byte for byte.
inline bool same_bytes(const engine::FrameProducts& a, const engine::FrameProducts& b) {
  const auto same = [](const auto& x, const auto& y) {
    return x.size() == y.size() && (x.empty() || std::memcmp(x.data(), y.data(), x.size() * sizeof x[0]) == 0);
  };
  return std::apply(
      [&](const auto&... of_a) {
        return std::apply([&](const auto&... of_b) { return (same(of_a, of_b) && ...); }, all_arrays(b));
      },
      all_arrays(a));
}

}  // namespace selenograph::test
