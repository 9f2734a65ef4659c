// Bounds of a block's terrain from its footprint and height range: a bounding sphere, and the convex hull of a few
// points plus a margin.
#pragma once

#include <array>

#include "dem/grid/geodesy.h"
#include "dem/grid/lattice.h"

namespace selenograph::engine {

struct NodeBounds {
  // A 3 x 3 lattice over the footprint, at the lowest and at the greatest height; MOON_ME, m.
  std::array<Vec3, 18> points;
  // Bulge of the datum between those points, m.
  double bulge_m;
  Vec3 centre;
  double radius_m;
  double low_m, high_m;
};

// Both return the bounds of a footprint with heights from low_m to high_m.
NodeBounds bounds_of(const dem::BlockId& id, double low_m, double high_m);
NodeBounds bounds_over(const dem::BlockExtent& extent, double low_m, double high_m);

// Returns bounds whose sphere contains the spheres of all narrower height ranges: what is out of reach of these bounds
// is out of reach of those, too.
NodeBounds bounds_of_all(const dem::BlockId& id, double low_m, double high_m);

// Returns the bounds of any sphere: all points are its centre, and the bulge is its radius.
NodeBounds bounds_around(const Vec3& centre_m, double radius_m);

// Returns true if the Moon's interior (below the lowest relief) hides the whole bounding sphere from `from_m` and from
// all positions within `around_m` of it.
bool below_horizon(const Vec3& from_m, const NodeBounds& bounds, double around_m = 0);

}  // namespace selenograph::engine
