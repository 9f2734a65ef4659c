// Terrain around a place as nested square grids, each twice as coarse as the one before and reaching farther: what
// light between slopes is gathered from.
//
// Coordinates are gnomonic: a direction d from the Moon's centre lies at R (d.x / d.z, d.y / d.z) in the grids' own
// axes, z up at their centre. Great circles are straight lines there, at a pole as anywhere, so that a march along an
// azimuth is a straight line.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/grid/geodesy.h"
#include "engine/indirect/march.h"

namespace selenograph::engine {

// Where the grids are and how fine. A grid of spacing s serves distances of up to 2 kStepsPerDistance s.
struct ReliefShape {
  Vec3 centre;              // unit
  double half_m;            // around it: half the side of what light is gathered for
  double spacing_m;         // of the finest grid
  double farthest_m = 2e5;  // beyond, no relief rises above the horizon
};

// Heights above the datum of unit directions (MOON_ME) from terrain with posts of that spacing, m; NaN: no data.
using ReliefHeights = std::function<void(double spacing_m, std::span<const Vec3> directions, std::span<float> heights)>;

// Rows: the axes of a relief's grids in MOON_ME, east, north and up at its centre.
Eigen::Matrix3d relief_axes(const Vec3& centre);

class Relief {
 public:
  Relief(const ReliefShape& shape, const ReliefHeights& heights, const StopToken& stop = {});

  const ReliefShape& shape() const { return shape_; }
  // Rows: the grids' axes in MOON_ME.
  const Eigen::Matrix3d& axes() const { return axes_; }
  std::size_t grids() const { return grids_.size(); }
  int side(std::size_t grid) const { return grids_[grid].side; }
  // Direction (unit, MOON_ME) of a post, row-major; with `middle` of the middle of the cell north-east of it.
  Vec3 direction(std::size_t grid, std::size_t post, bool middle = false) const;
  // The cell north-east of a post: its mean height above the reference and unit normal in the grids' axes, from its
  // four corners; NaN and zero where one has no data.
  struct Cell {
    float height;
    Eigen::Vector3f normal;
  };
  Cell cell(std::size_t grid, std::size_t post) const;

  // Sixteen posts of the finest grid, `stride` columns apart; their ux and uy are not set.
  MarchLanes places(int row, int column, int stride) const;
  // Row and column of the finest grid's middle, where shape().centre is.
  int middle() const { return grids_.front().side / 2; }

  // For marching. Heights are above reference_m above the datum.
  std::vector<GridView> views() const;
  double reference_m() const { return reference_m_; }
  std::size_t bytes() const;
  MarchSphere sphere() const {
    return {static_cast<float>(kMoonRadius_m + reference_m_), static_cast<float>(kMoonRadius_m),
            static_cast<float>(shape_.farthest_m)};
  }

 private:
  struct Grid {
    int side;
    double spacing_m;
    std::vector<float> heights;  // and kPadding more
    float highest_m = -std::numeric_limits<float>::infinity();
    std::size_t posts() const { return static_cast<std::size_t>(side) * static_cast<std::size_t>(side); }
    double place(double i) const { return (i - (side - 1) / 2.0) * spacing_m; }
  };
  Vec3 at(const Grid& grid, int row, int column) const;

  ReliefShape shape_;
  Eigen::Matrix3d axes_;
  double reference_m_ = 0;
  std::vector<Grid> grids_;
};

}  // namespace selenograph::engine
