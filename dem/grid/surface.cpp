#include "dem/grid/surface.h"

namespace selenograph::dem {

std::optional<double> radial_distance(const Triangle& t, const Vec3& direction, double slack) {
  // Compute the barycentric coordinates v and w of the intersection with the triangle's plane.
  const Vec3 ab = t.b - t.a, ac = t.c - t.a;
  const Vec3 normal = ab.cross(ac);
  const double through = normal.dot(direction);
  if (!(through > 0)) return std::nullopt;
  const double distance = normal.dot(t.a) / through;
  const Vec3 p = direction * distance - t.a;
  const double v = normal.dot(p.cross(ac)) / normal.squared_norm(), w = normal.dot(ab.cross(p)) / normal.squared_norm();
  if (v < -slack || w < -slack || v + w > 1 + slack) return std::nullopt;
  return distance;
}

}  // namespace selenograph::dem
