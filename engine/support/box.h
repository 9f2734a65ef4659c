// Boxes along the axes.
#pragma once

#include <limits>

#include "dem/grid/vec.h"

namespace selenograph::engine {

// Empty until it is extended.
struct Box3 {
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Vec3 min = Vec3::constant(kInfinity), max = Vec3::constant(-kInfinity);

  void extend(const Vec3& p) { *this = {min_of(min, p), max_of(max, p)}; }
  void extend(const Box3& b) { *this = {min_of(min, b.min), max_of(max, b.max)}; }
  Vec3 size() const { return max - min; }
  Vec3 centre() const { return (min + max) / 2; }
  bool intersects(const Box3& b) const {
    for (int i = 0; i < 3; ++i)
      if (!(min[i] <= b.max[i] && b.min[i] <= max[i])) return false;
    return true;
  }
};

}  // namespace selenograph::engine
