// Terrain around a place as nested square grids of heights, over which marches find horizons and visible ground.
//
// +---------------------+    Each grid has twice the spacing of the one inside it, and serves twice its distance:
// | grid 2              |
// |   +-------------+   |      distance  0 ..... P s ........ 2 P s ................ 4 P s
// |   | grid 1      |   |      read from  grid 0     grid 1           grid 2
// |   |   +-----+   |   |
// |   |   | . . |   |   |    s: spacing of the finest grid; P: posts_per_distance
// |   |   | . . |   |   |    . places from which marches begin, up to half_m from the centre
// |   |   +-----+   |   |
// |   +-------------+   |
// +---------------------+
//
// Coordinates are gnomonic: a direction d from the Moon's centre lies at R (d.x / d.z, d.y / d.z) in the grids' own
// axes, z up at their centre. Great circles are straight lines there, at a pole as anywhere, so that a march along an
// azimuth is a straight line.
#pragma once

#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/grid/geodesy.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// Extra elements at the end of each array of a grid, because rows are read in full vectors.
inline constexpr std::size_t kPadding = 4 * kPacket;

// Position and resolution of the grids.
struct ReliefShape {
  Vec3 centre;                     // unit vector, MOON_ME
  double half_m;                   // half the side of the square around the centre that holds all places, on the plane
  double spacing_m;                // of the finest grid
  double farthest_m = 2e5;         // distance at which marches end, along the sphere
  double posts_per_distance = 96;  // of a grid, along the distance from which the next one is read
  double turn_rad = 0;             // of the grids' rows from east at the centre, counter-clockwise
  // Places may stand on every 2^n-th post of the finest grid in both directions, beginning at the centre; -1: anywhere.
  int lattice_log2 = -1;
  float void_height_m = std::numeric_limits<float>::quiet_NaN();  // stands for missing data
};

// A grid, numbered by rows from the south-west.
//
// For places on a lattice of every 2^n-th post, posts at one offset from four neighbouring places are adjacent: a row
// holds the columns 0, 2^n, 2 2^n .., then 1, 2^n + 1 .., and so on, each sequence a run.
struct ReliefGrid {
  int side;
  double spacing_m;
  double to_m;                 // distance along the sphere up to which this grid is read
  std::vector<float> heights;  // m above the reference, then kPadding more
  bool has_lattice = false;
  int columns_log2 = 0;  // n; 0 without a lattice
  int run = 0;           // posts of a run
  int pitch = 0;         // posts from row to row
  float middle = 0;      // row and column of the centre
  float posts_per_m = 0;
  float coarser = 1;  // spacing over the finest grid's: a power of two
  // Greatest height of this grid and the coarser ones.
  float highest_m = -std::numeric_limits<float>::infinity();
  // Returns the index of a post in `heights`.
  std::ptrdiff_t index(int column, int row) const {
    const int remainder = column & ((1 << columns_log2) - 1);
    return static_cast<std::ptrdiff_t>(row) * pitch + remainder * run + (column >> columns_log2);
  }
  // Returns the coordinate of row or column `i`, m from the centre.
  double coordinate_m(double i) const { return (i - (side - 1) / 2.0) * spacing_m; }
};

// Sets heights above the datum in unit directions (MOON_ME), m, from terrain with posts of that spacing; NaN without
// data.
using ReliefHeights = std::function<void(double spacing_m, std::span<const Vec3> directions, std::span<float> heights)>;

// Returns the axes of grids that are not turned as rows: east, north and up at their centre, in MOON_ME.
Mat3 relief_axes(const Vec3& centre);
// Returns the number of posts of all grids.
double post_count(const ReliefShape& shape);

class Relief {
 public:
  Relief(const ReliefShape& shape, const ReliefHeights& heights, const StopToken& stop = {});

  const ReliefShape& shape() const { return shape_; }
  // Axes of the grids as rows, in MOON_ME: along their rows, along their columns, up at the centre.
  const Mat3& axes() const { return axes_; }
  // The grids, from the finest on. Their heights are relative to reference_m() above the datum.
  std::span<const ReliefGrid> grids() const { return grids_; }
  double reference_m() const { return reference_m_; }
  double reference_radius_m() const { return kMoonRadius_m + reference_m_; }
  // Returns the direction (unit, MOON_ME) of a post, numbered row by row; with `cell_middle`, of the middle of the cell
  // north-east of it.
  Vec3 direction(std::size_t grid, std::size_t post, bool cell_middle = false) const;
  // Mean height of a cell above the reference, and its unit normal in the grids' axes, from its four corners. NaN and
  // zero if a corner has no data.
  struct Cell {
    float height;
    Vec3f normal;
  };
  // Returns the cell north-east of a post. For a relief without a lattice.
  Cell cell(std::size_t grid, std::size_t post) const;
  // Returns the finest grid's height at a point of the plane, m above the datum; empty without data.
  std::optional<double> height_m(double x_m, double y_m) const;
  // Row and column of the finest grid's middle, the centre of the shape.
  int middle() const { return grids_.front().side / 2; }
  std::size_t bytes() const;

 private:
  void read_heights(std::size_t grid, const ReliefHeights& heights, const StopToken& stop);
  // Makes a grid's heights relative to the reference, and arranges its columns for the lattice.
  void finish(std::size_t grid);
  // Returns the position of a post in the grids' axes, m.
  Vec3 position_of(const ReliefGrid& grid, int row, int column) const;

  ReliefShape shape_;
  Mat3 axes_;
  double reference_m_ = 0;
  std::vector<ReliefGrid> grids_;
};

}  // namespace selenograph::engine
