#include "engine/support/turn.h"

#include <cmath>
#include <numbers>

namespace selenograph::engine {

Quat shortest_turn(const Vec3& from, const Vec3& to) {
  const Vec3 a = from.normalized(), b = to.normalized();
  const double cosine = b.dot(a);
  constexpr double kOpposite = 1e-12;
  if (cosine < -1 + kOpposite) return Quat(AngleAxis(std::numbers::pi, a.unit_orthogonal()));
  const double twice_cosine_of_half = std::sqrt((1 + cosine) * 2);
  const Vec3 axis = a.cross(b) * (1 / twice_cosine_of_half);
  return {twice_cosine_of_half * 0.5, axis.x(), axis.y(), axis.z()};
}

}  // namespace selenograph::engine
