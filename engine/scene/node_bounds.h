// Where a block's terrain can be: a ball and a handful of points, from its footprint and lowest and highest height.
#pragma once

#include <array>

#include "dem/grid/geodesy.h"
#include "dem/grid/lattice.h"

namespace selenograph::engine {

struct NodeBounds {
  // A 3 x 3 lattice over the footprint, at the lowest and at the highest height.
  std::array<Vec3, 18> points;
  // What the sphere bulges between those points, m.
  double bulge_m;
  Vec3 centre;
  double radius_m;
  double low_m, high_m;
};

NodeBounds bounds_of(const dem::BlockId& id, double low_m, double high_m);

// The same with a ball that holds those of all bounds whose heights lie between these: what can't matter within them
// can't within any of those.
NodeBounds bounds_of_all(const dem::BlockId& id, double low_m, double high_m);

// Of a ball that isn't terrain; all of its points are the centre, and it bulges by its radius.
NodeBounds bounds_around(const Vec3& centre_m, double radius_m);

// Whether the Moon's solid inside (everything deeper than the lowest relief) hides the whole ball from `from` and all
// places no farther than `around_m` from there.
bool below_horizon(const Vec3& from_m, const NodeBounds& bounds, double around_m = 0);

}  // namespace selenograph::engine
