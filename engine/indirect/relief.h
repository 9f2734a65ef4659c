// Terrain around a point as nested square grids of heights, from which light between slopes is gathered.
//
// +---------------------+    Each grid has twice the spacing of the one inside it. Grid k ends where
// | grid 2              |    steps of a march span kPostsPerStep posts of grid k + 1, seen from the
// |   +-------------+   |    farthest point that gathers light.
// |   | grid 1      |   |
// |   |   +-----+   |   |    . points that gather light, up to half_m from the centre
// |   |   | . . |   |   |
// |   |   | . . |   |   |
// |   |   +-----+   |   |
// |   +-------------+   |
// +---------------------+
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

// Position and resolution of the grids. A grid of spacing s serves distances of up to 2 kPostsPerStep kStepsPerDistance
// s.
struct ReliefShape {
  Vec3 centre;              // unit vector, MOON_ME
  double half_m;            // half the side of the square around the centre in which light is gathered
  double spacing_m;         // spacing of the finest grid
  double farthest_m = 2e5;  // no relief beyond this distance rises above the horizon
};

// Sets heights above the datum in unit directions (MOON_ME), m, from terrain with posts of that spacing; NaN without
// data.
using ReliefHeights = std::function<void(double spacing_m, std::span<const Vec3> directions, std::span<float> heights)>;

// Returns the axes of a relief's grids as rows: east, north and up at its centre, in MOON_ME.
Eigen::Matrix3d relief_axes(const Vec3& centre);

class Relief {
 public:
  Relief(const ReliefShape& shape, const ReliefHeights& heights, const StopToken& stop = {});

  const ReliefShape& shape() const { return shape_; }
  // Axes of the grids as rows, in MOON_ME.
  const Eigen::Matrix3d& axes() const { return axes_; }
  std::size_t grids() const { return grids_.size(); }
  int side(std::size_t grid) const { return grids_[grid].side; }
  // Returns the direction (unit, MOON_ME) of a post, numbered row by row; with `cell_middle`, of the middle of the cell
  // north-east of it.
  Vec3 direction(std::size_t grid, std::size_t post, bool cell_middle = false) const;
  // Mean height of a cell above the reference, and its unit normal in the grids' axes, from its four corners. NaN and
  // zero if a corner has no data.
  struct Cell {
    float height;
    Eigen::Vector3f normal;
  };
  // Returns the cell north-east of a post.
  Cell cell(std::size_t grid, std::size_t post) const;

  // Returns sixteen posts of the finest grid, `stride` columns apart. The caller sets their direction.
  MarchLanes march_lanes(int row, int column, int stride) const;
  // Row and column of the finest grid's middle, the centre of the shape.
  int middle() const { return grids_.front().side / 2; }

  // Returns the grids for marches. Their heights are relative to reference_m() above the datum.
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
    std::vector<float> heights;  // row by row from the south-west, then kPadding more; relative to reference_m_
    float highest_m = -std::numeric_limits<float>::infinity();
    std::size_t posts() const { return static_cast<std::size_t>(side) * static_cast<std::size_t>(side); }
    // Returns the coordinate of row or column `i`, m from the centre.
    double coordinate_m(double i) const { return (i - (side - 1) / 2.0) * spacing_m; }
  };
  // Returns the position of a post in the grids' axes, m.
  Vec3 position_of(const Grid& grid, int row, int column) const;

  ReliefShape shape_;
  Eigen::Matrix3d axes_;
  double reference_m_ = 0;
  std::vector<Grid> grids_;
};

}  // namespace selenograph::engine
