// Posts read from a file, and heights between them.
#pragma once

#include <cmath>
#include <cstddef>

#include "dem/base/uninitialised.h"

namespace selenograph::dem {

// A rectangle of posts read from a file.
struct PostPatch {
  int x0, y0, w, h;
  UninitialisedVector<float> posts;
  float at(int x, int y) const { return posts[index(x, y)]; }
  float& at(int x, int y) { return posts[index(x, y)]; }
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y - y0) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x - x0);
  }
};

// Position along a row or column: at or after a post. Places within rounding of a post are on it, so that neighbouring
// no-data does not matter.
struct Place {
  int post;
  double fraction;
  explicit Place(double v) {
    if (const double near = std::round(v); std::abs(v - near) < 1e-6) v = near;
    post = static_cast<int>(std::floor(v)), fraction = v - post;
  }
};

// Catmull-Rom, exact for a linear slope; bilinear if no-data is among the sixteen posts. NaN next to no-data. The patch
// must hold columns x-1 .. x+2 and rows y-1 .. y+2 around the place.
float interpolate(const PostPatch& patch, const Place& px, const Place& py);

// Extrapolates by less than a post from a valid one, along its slope: beside no-data or beyond the last row or column.
// Without this a product whose posts are not vertices would lose its outermost posts and the quads around them.
float extended(const PostPatch& patch, double px, double py);

}  // namespace selenograph::dem
