// The surface between posts: plane triangles, two per quad, intersected by rays from the Moon's centre.
//
// A quad's diagonal runs from its south-east to its north-west vertex:
//
//   (r+1, c) o-------o (r+1, c+1)
//            | \ upper|
//            |lower \ |
//     (r, c) o-------o (r, c+1)
//
// The mesh is star-shaped about the centre: each direction intersects exactly one triangle, for any curvature of the
// lattice.
#pragma once

#include <optional>

#include "dem/grid/block.h"

namespace selenograph::dem {

struct Triangle {
  Vec3 a, b, c;  // counter-clockwise from outside
};

// Returns the distance along a unit direction from the Moon's centre to the triangle's plane, if the direction passes
// through the triangle, or outside it within `slack`, in barycentric coordinates.
std::optional<double> radial_distance(const Triangle& t, const Vec3& direction, double slack);

// Rows and columns of a triangle's vertices, counter-clockwise.
struct QuadVertices {
  int r[3], c[3];
};
// Returns the lower (south-western) or upper (north-eastern) triangle of the quad whose south-west vertex is (r, c).
inline QuadVertices vertices_of(int r, int c, bool upper) {
  if (!upper) return {{r, r, r + 1}, {c, c + 1, c}};
  return {{r + 1, r + 1, r}, {c + 1, c, c + 1}};
}

}  // namespace selenograph::dem
