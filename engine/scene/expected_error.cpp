#include "engine/scene/expected_error.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace selenograph::engine {

double largest_sine_of_emission(const Vec3& camera_m, const Vec3& centre_m, double radius_m) {
  const Vec3 to_camera = camera_m - centre_m;
  const double distance_m = to_camera.norm();
  if (distance_m <= radius_m) return 1;
  // Add the turns within the ball: the vertical's, radius_m / |centre_m|, and the line of sight's, asin(radius_m /
  // distance_m).
  const double emission_rad =
      angle_between(to_camera, centre_m) + radius_m / centre_m.norm() + std::asin(radius_m / distance_m);
  return emission_rad >= std::numbers::pi / 2 ? 1 : std::sin(emission_rad);
}

double expected_error(std::vector<BlockError> blocks, double BlockError::*member) {
  constexpr double kShare = 0.99;
  std::sort(blocks.begin(), blocks.end(),
            [&](const BlockError& a, const BlockError& b) { return a.*member < b.*member; });
  double pixels = 0;
  for (const BlockError& block : blocks) pixels += block.pixels;
  double below = 0;
  for (const BlockError& block : blocks)
    if ((below += block.pixels) >= kShare * pixels) return block.*member;
  return 0;
}

}  // namespace selenograph::engine
