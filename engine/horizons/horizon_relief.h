// Nested grids of heights around a tile of a map, and the plan of marches over them.
//
// +-----------------------+    Grid k has twice the spacing of grid k - 1 and serves twice its distance, so that a post
// | grid 2                |    is never wider than 1 / kPostsPerDistance of its distance, except next to the place:
// |   +---------------+   |
// |   | grid 1        |   |      distance  0 ..... K s ........ 2 K s ................ 4 K s
// |   |   +-------+   |   |      read from  grid 0     grid 1           grid 2
// |   |   | tile  |   |   |
// |   |   +-------+   |   |    A grid is as wide as its distance on each side of the tile.
// |   +---------------+   |
// +-----------------------+
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "engine/horizons/horizon_march.h"
#include "engine/indirect/relief.h"

namespace selenograph::engine {

// Posts of a grid along the distance from which the next one, twice as coarse, is read.
inline constexpr double kPostsPerDistance = 1000;

struct HorizonReliefShape {
  Vec3 centre;          // unit vector, MOON_ME
  double half_m;        // half the side of the square around the centre in which places lie, on the gnomonic plane
  double spacing_m;     // spacing of the finest grid
  double farthest_m;    // distance at which marches end, along the sphere
  double turn_rad = 0;  // of the grids' rows from east at the centre, counter-clockwise
  // Places may stand on every 2^n-th post of the finest grid in both directions, beginning at the centre; -1: anywhere.
  int lattice_log2 = -1;
};

// Returns the axes of the grids as rows, in MOON_ME: along their rows, along their columns, up at the centre.
Eigen::Matrix3d axes_of(const HorizonReliefShape& shape);
// Returns the number of posts of all grids.
double posts_of(const HorizonReliefShape& shape);

class HorizonRelief {
 public:
  HorizonRelief(const HorizonReliefShape& shape, const ReliefHeights& heights, const StopToken& stop);

  const MarchPlan& plan() const { return plan_; }
  const Eigen::Matrix3d& axes() const { return axes_; }
  double reference_m() const { return reference_m_; }
  // Spacing of the finest grid.
  double spacing_m() const { return shape_.spacing_m; }
  // Returns the finest grid's height at a point of the plane, m above the datum; empty without data.
  std::optional<double> height_m(double x_m, double y_m) const;
  std::size_t bytes() const;

 private:
  HorizonReliefShape shape_;
  Eigen::Matrix3d axes_;
  double reference_m_ = 0;
  std::vector<std::vector<float>> heights_;  // of each grid, relative to the reference
  MarchPlan plan_;
};

}  // namespace selenograph::engine
