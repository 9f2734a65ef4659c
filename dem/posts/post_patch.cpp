#include "dem/posts/post_patch.h"

#include <limits>

#include "dem/grid/block.h"

namespace selenograph::dem {

namespace {

// Returns the height interpolated between the four posts around (x + fx, y + fy).
float bilinear(const PostPatch& patch, int x, int y, double fx, double fy) {
  double sum = 0;
  for (int j = 0; j < 2; ++j)
    for (int i = 0; i < 2; ++i) {
      const double weight = (i ? fx : 1 - fx) * (j ? fy : 1 - fy);
      if (weight == 0) continue;  // skip NaN neighbours that a position on a post does not need
      sum += weight * static_cast<double>(patch.at(x + i, y + j));
    }
  return static_cast<float>(sum);
}

}  // namespace

// Interpolates along the four rows around the position, then between them.
float interpolate(const PostPatch& patch, const PostPosition& px, const PostPosition& py) {
  const int x = px.post, y = py.post;
  const double fx = px.fraction, fy = py.fraction;
  if (fx == 0 && fy == 0) return patch.at(x, y);
  const auto wx = cubic_weights(fx), wy = cubic_weights(fy);
  double sum = 0;
  for (int j = 0; j < 4; ++j) {
    double row = 0;
    for (int i = 0; i < 4; ++i)
      row += wx[static_cast<std::size_t>(i)] * static_cast<double>(patch.at(x - 1 + i, y - 1 + j));
    sum += wy[static_cast<std::size_t>(j)] * row;
  }
  return std::isnan(sum) ? bilinear(patch, x, y, fx, fy) : static_cast<float>(sum);
}

// Takes the nearest valid post of the four around the position.
float extrapolate(const PostPatch& patch, double px, double py) {
  const int x0 = static_cast<int>(std::floor(px)), y0 = static_cast<int>(std::floor(py));
  float best = std::numeric_limits<float>::quiet_NaN();
  double nearest = std::numeric_limits<double>::infinity();
  for (int y = y0; y <= y0 + 1; ++y)
    for (int x = x0; x <= x0 + 1; ++x) {
      const float h = patch.at(x, y);
      const double dx = px - x, dy = py - y, distance = dx * dx + dy * dy;
      if (std::isnan(h) || distance >= nearest) continue;
      nearest = distance;
      // Returns the slope along an axis, m per post, from a valid neighbour; 0 if there is none.
      const auto slope = [h](float before, float after) {
        return !std::isnan(before) ? h - before : !std::isnan(after) ? after - h : 0.F;
      };
      best = h + static_cast<float>(dx * static_cast<double>(slope(patch.at(x - 1, y), patch.at(x + 1, y))) +
                                    dy * static_cast<double>(slope(patch.at(x, y - 1), patch.at(x, y + 1))));
    }
  return best;
}

bool keep_ground(std::span<float> heights_m, double offset_m) {
  constexpr float kVoid_m = -9999;
  bool any = false;
  for (float& height_m : heights_m) {
    const auto shifted_m = static_cast<float>(static_cast<double>(height_m) + offset_m);
    const bool is_none = height_m == kVoid_m || shifted_m < kLowestRelief_m || shifted_m > kHighestRelief_m;
    any |= is_none;
    height_m = is_none ? std::numeric_limits<float>::quiet_NaN() : shifted_m;
  }
  return any;
}

}  // namespace selenograph::dem
