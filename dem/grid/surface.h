// The surface between posts: plane triangles, two per quad, intersected by rays from the Moon's centre.
//
// A quad's diagonal runs from its south-east to its north-west vertex. The mesh is star-shaped about the centre: each
// direction intersects exactly one triangle, for any curvature of the lattice; that triangle contains the place.
#pragma once

#include <optional>

#include "dem/grid/block.h"

namespace selenograph::dem {

struct Triangle {
  Vec3 a, b, c;  // counter-clockwise from outside
};

// Distance along the unit direction from the Moon's centre to the triangle's plane, if the direction passes through it
// (or within `slack`, a fraction of its size, outside).
std::optional<double> radial_distance(const Triangle& t, const Vec3& direction, double slack);

// lower: the south-western triangle of the quad whose south-west vertex is (r, c); upper: the north-eastern.
struct QuadVertices {
  int r[3], c[3];
};
inline QuadVertices vertices_of(int r, int c, bool upper) {
  if (!upper) return {{r, r, r + 1}, {c, c + 1, c}};
  return {{r + 1, r + 1, r}, {c + 1, c, c + 1}};
}

}  // namespace selenograph::dem
