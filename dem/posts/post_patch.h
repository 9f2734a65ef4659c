// Posts read from a file, and interpolation between posts.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <span>

#include "dem/base/uninitialised.h"

namespace selenograph::dem {

// Returns the Catmull-Rom weights (Catmull & Rom 1974, tension 1/2) of four posts, at fraction t between the middle
// two.
inline std::array<double, 4> cubic_weights(double t) {
  return {t * (-0.5 + t * (1.0 - 0.5 * t)), 1.0 + t * t * (-2.5 + 1.5 * t), t * (0.5 + t * (2.0 - 1.5 * t)),
          t * t * (-0.5 + 0.5 * t)};
}

// Rectangle of posts of a file. Column x0 and row y0 come first.
struct PostPatch {
  int x0, y0, w, h;
  UninitialisedVector<float> posts;
  float at(int x, int y) const { return posts[index(x, y)]; }
  float& at(int x, int y) { return posts[index(x, y)]; }
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y - y0) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x - x0);
  }
};

// Position along a row or column of a file. Positions within rounding of a post are on it, so that no-data in
// neighbouring posts does not matter.
struct PostPosition {
  int post;         // the post at or before the position
  double fraction;  // distance from that post, 0 <= fraction < 1
  explicit PostPosition(double v) {
    if (const double near = std::round(v); std::abs(v - near) < 1e-6) v = near;
    post = static_cast<int>(std::floor(v));
    fraction = v - post;
  }
};

// Adds an offset to heights of a file, and turns those that no ground of the Moon has into NaN: out of range, or -9999,
// a usual mark of voids that lies below the Moon's lowest ground. Returns true if there were any.
bool keep_ground(std::span<float> heights_m, double offset_m);

// Returns a height by Catmull-Rom interpolation, exact for a linear slope; bilinear if no-data is among the sixteen
// posts; NaN next to no-data. The patch must hold columns x-1 .. x+2 and rows y-1 .. y+2 around the position.
float interpolate(const PostPatch& patch, const PostPosition& px, const PostPosition& py);

// Returns the nearest valid post's height, extrapolated by less than a post along its slope: next to no-data or beyond
// the last row or column. Without this a product whose posts are not vertices would lose its outermost posts and the
// quads around them.
float extrapolate(const PostPatch& patch, double px, double py);

}  // namespace selenograph::dem
