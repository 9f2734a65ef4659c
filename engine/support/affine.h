// Affine maps of space.
#pragma once

#include "dem/grid/vec.h"

namespace selenograph::engine {

struct Affine {
  Mat3 linear = Mat3::identity();
  Vec3 translation = Vec3::zero();

  Vec3 operator*(const Vec3& p) const { return linear * p + translation; }
  // Returns the map by b, then by a.
  friend Affine operator*(const Affine& a, const Affine& b) { return {a.linear * b.linear, a * b.translation}; }
  Affine inverse() const {
    const Mat3 inverse_linear = linear.inverse();
    return {inverse_linear, -inverse_linear * translation};
  }
};

}  // namespace selenograph::engine
