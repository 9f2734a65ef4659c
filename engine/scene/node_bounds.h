// Bounds of a block's terrain: a bounding sphere and a few points, from its footprint and height range.
#pragma once

#include <array>

#include "dem/grid/geodesy.h"
#include "dem/grid/lattice.h"

namespace selenograph::engine {

struct NodeBounds {
  // A 3 x 3 lattice over the footprint, at the lowest and at the highest height.
  std::array<Vec3, 18> points;
  // Bulge of the datum between those points, m.
  double bulge_m;
  Vec3 centre;
  double radius_m;
  double low_m, high_m;
};

NodeBounds bounds_of(const dem::BlockId& id, double low_m, double high_m);
NodeBounds bounds_over(const dem::BlockExtent& extent, double low_m, double high_m);

// The same with a sphere that contains the spheres of all height ranges within this one: what cannot matter within
// these bounds cannot matter within any of those.
NodeBounds bounds_of_all(const dem::BlockId& id, double low_m, double high_m);

// Bounds of a sphere that is not terrain; all points are its centre, and the bulge is its radius.
NodeBounds bounds_around(const Vec3& centre_m, double radius_m);

// Whether the Moon's interior (below the lowest relief) hides the whole bounding sphere from `from` and from all places
// within `around_m` of it.
bool below_horizon(const Vec3& from_m, const NodeBounds& bounds, double around_m = 0);

}  // namespace selenograph::engine
