#include "dem/detail/region.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "dem/base/smoothstep.h"

namespace selenograph::dem {
namespace {

// Returns a positive value left of the line from a to b, a negative one right of it, 0 on it.
double side_of(const Vec2& p, const Vec2& a, const Vec2& b) {
  return (b.x() - a.x()) * (p.y() - a.y()) - (b.y() - a.y()) * (p.x() - a.x());
}

// Returns whether the edges ab and cd intersect: each has its ends on both sides of the other. Touching counts.
//
//      a    d
//       \  /
//        \/        a and b lie on different sides of cd, c and d on different sides of ab
//        /\        .
//       c  b
bool intersect(const Vec2& a, const Vec2& b, const Vec2& c, const Vec2& d) {
  return side_of(a, c, d) * side_of(b, c, d) <= 0 && side_of(c, a, b) * side_of(d, a, b) <= 0;
}

double arc_m(const Vec3& a, const Vec3& b) { return 2 * std::asin(std::min(1.0, (a - b).norm() / 2)) * kMoonRadius_m; }

}  // namespace

// The polygon on the sphere and on the gnomonic plane, which touches the sphere at the corners' middle. There great
// circles are straight lines, so that plane geometry decides on intersections and on containment.
struct Region::Polygon {
  Vec3 middle, right, up;
  std::vector<Vec3> corners;
  std::vector<Vec2> flat;

  // Projects a direction, which must be less than 90 degrees from the middle.
  Vec2 onto_plane(const Vec3& p) const { return Vec2(p.dot(right), p.dot(up)) / p.dot(middle); }
};

Region::Region(const std::vector<Geographic>& corners) {
  if (corners.size() < 3) throw std::invalid_argument("has fewer than three corners");
  Polygon polygon;
  polygon.middle = Vec3::zero();
  for (const Geographic& corner : corners) {
    polygon.corners.push_back(to_cartesian({corner.lat_deg, corner.lon_deg, 0}).normalized());
    polygon.middle += polygon.corners.back();
  }
  const double length = polygon.middle.norm();
  if (length > 0) polygon.middle /= length;
  for (const Vec3& corner : polygon.corners)
    if (!(corner.dot(polygon.middle) > std::cos(kWidest_deg * kRadiansPerDegree)))
      throw std::invalid_argument("has a corner more than 60 degrees from the middle of all");
  polygon.right = polygon.middle.unit_orthogonal();
  polygon.up = polygon.middle.cross(polygon.right);
  for (const Vec3& corner : polygon.corners) polygon.flat.push_back(polygon.onto_plane(corner));
  const std::size_t n = corners.size();
  const auto at = [&](std::size_t i) -> const Vec2& { return polygon.flat[i % n]; };
  for (std::size_t i = 0; i < n; ++i) {
    if (at(i) == at(i + 1)) throw std::invalid_argument("has the same corner twice in a row");
    for (std::size_t k = i + 2; k < n; ++k)
      if ((k + 1) % n != i && intersect(at(i), at(i + 1), at(k), at(k + 1)))
        throw std::invalid_argument("has edges that meet");
  }
  polygon_ = std::make_shared<const Polygon>(std::move(polygon));
}

// Counts the edges that a ray from the position in +x crosses: an odd number means inside.
bool Region::polygon_holds(const Vec3& direction) const {
  if (!(direction.dot(polygon_->middle) > std::cos(kWidest_deg * kRadiansPerDegree))) return false;
  const Vec2 p = polygon_->onto_plane(direction);
  bool inside = false;
  const std::vector<Vec2>& c = polygon_->flat;
  for (std::size_t i = 0, before = c.size() - 1; i < c.size(); before = i++) {
    if ((c[i].y() > p.y()) == (c[before].y() > p.y())) continue;
    inside ^= p.x() < c[i].x() + (p.y() - c[i].y()) / (c[before].y() - c[i].y()) * (c[before].x() - c[i].x());
  }
  return inside;
}

// Returns the distance to the nearest edge, an arc between two corners; negative outside.
double Region::inside_m(const Vec3& direction) const {
  if (everywhere()) return std::numeric_limits<double>::infinity();
  const std::vector<Vec3>& corners = polygon_->corners;
  double nearest_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0, before = corners.size() - 1; i < corners.size(); before = i++) {
    const Vec3 &a = corners[before], &b = corners[i], normal = a.cross(b).normalized();
    // The nearest point of the edge is the foot of the perpendicular if that lies between its ends, else an end.
    const bool has_foot = normal.cross(a).dot(direction) >= 0 && b.cross(normal).dot(direction) >= 0;
    nearest_m = std::min(nearest_m, has_foot ? std::asin(std::min(1.0, std::abs(normal.dot(direction)))) * kMoonRadius_m
                                             : std::min(arc_m(a, direction), arc_m(b, direction)));
  }
  return polygon_holds(direction) ? nearest_m : -nearest_m;
}

double Region::share(const Vec3& direction, double fade_m) const { return smoothstep(inside_m(direction) / fade_m); }

}  // namespace selenograph::dem
