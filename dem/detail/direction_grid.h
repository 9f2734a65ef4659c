// Grid of positions on the sphere at which detail is evaluated.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "dem/grid/degrees.h"
#include "dem/grid/geodesy.h"
#include "dem/grid/lattice.h"

namespace selenograph::dem {

// Sines and cosines of rows of equal latitude and columns of equal longitude, both ascending, no wider than a quarter
// of the globe. Rows beyond a pole continue on the opposite meridian, where cos(latitude) is negative.
struct DirectionGrid {
  std::span<const double> sin_lat, cos_lat, sin_lon, cos_lon;
  double west, lon_step;  // longitude of the first column and spacing of columns, radians
  std::size_t rows() const { return sin_lat.size(); }
  std::size_t columns() const { return sin_lon.size(); }
  Vec3 direction(std::size_t r, std::size_t c) const {
    return {cos_lat[r] * cos_lon[c], cos_lat[r] * sin_lon[c], sin_lat[r]};
  }
};

// The ball that bounds a grid's positions on the sphere, around the direction of its middle; its radius is a chord.
struct BoundingBall {
  Vec3 direction;
  double radius_m;
};
BoundingBall ball_around(const DirectionGrid& grid);

// Return the rows and the columns, first and past the last, that a circle may reach. `reach`: its radius, a chord of
// the unit sphere. The columns are not valid for rows beyond a pole: visit all of them there.
std::pair<std::size_t, std::size_t> rows_within(const DirectionGrid& grid, const Vec3& centre, double reach);
std::pair<std::size_t, std::size_t> columns_within(const DirectionGrid& grid, const Vec3& centre, double reach);

// Calls visit(row, first column, past the last column) for the rows that such a circle may reach.
template <typename Visit>
void visit_rows_within(const DirectionGrid& grid, const Vec3& centre, double reach, const Visit& visit) {
  const auto [first_column, past_column] = columns_within(grid, centre, reach);
  const auto [first_row, past_row] = rows_within(grid, centre, reach);
  for (std::size_t r = first_row; r < past_row; ++r) {
    const bool past_pole = grid.cos_lat[r] < 0;  // on the opposite meridian, where the range of columns is not valid
    visit(r, past_pole ? 0 : first_column, past_pole ? grid.columns() : past_column);
  }
}

// Calls visit(post, east, north) for the positions that a circle of diameter `size_m` may reach, with their offsets
// from its centre in diameters. Positions are numbered row by row.
template <typename Visit>
void visit_posts_within(const DirectionGrid& grid, const Vec3& centre, double size_m, const Visit& visit) {
  const double size = size_m / kMoonRadius_m;  // a chord of the unit sphere
  const EastNorthUp local = local_axes(centre);
  const Vec3 to_east = local.east / size, to_north = local.north / size;
  visit_rows_within(grid, centre, size / 2, [&](std::size_t r, std::size_t first_column, std::size_t past_column) {
    for (std::size_t c = first_column; c < past_column; ++c) {
      const Vec3 from_centre = grid.direction(r, c) - centre;
      visit(r * grid.columns() + c, static_cast<float>(to_east.dot(from_centre)),
            static_cast<float>(to_north.dot(from_centre)));
    }
  });
}

// Returns a rectangle of a grid, without copying its tables.
inline DirectionGrid sub_grid(const DirectionGrid& grid, std::size_t first_row, std::size_t rows,
                              std::size_t first_column, std::size_t columns) {
  return {grid.sin_lat.subspan(first_row, rows),
          grid.cos_lat.subspan(first_row, rows),
          grid.sin_lon.subspan(first_column, columns),
          grid.cos_lon.subspan(first_column, columns),
          grid.west + static_cast<double>(first_column) * grid.lon_step,
          grid.lon_step};
}

// A DirectionGrid with as many rows as columns, given by its south-western position and its steps in radians. Owns the
// tables.
class SquareGrid {
 public:
  SquareGrid(double south, double lat_step, double west, double lon_step, std::size_t side)
      : west_(west), lon_step_(lon_step) {
    for (std::size_t i = 0; i < side; ++i) {
      const double lat = south + static_cast<double>(i) * lat_step, lon = west + static_cast<double>(i) * lon_step;
      sin_lat_.push_back(std::sin(lat));
      cos_lat_.push_back(std::cos(lat));
      sin_lon_.push_back(std::sin(lon));
      cos_lon_.push_back(std::cos(lon));
    }
  }
  DirectionGrid grid() const { return {sin_lat_, cos_lat_, sin_lon_, cos_lon_, west_, lon_step_}; }

 private:
  std::vector<double> sin_lat_, cos_lat_, sin_lon_, cos_lon_;
  double west_, lon_step_;
};

// Directions of a square grid relative to a block's posts; it may be denser than the posts and extend past the block.
// Rows beyond a pole continue on the opposite meridian, where cos(latitude) is negative.
class BlockDirections {
 public:
  // `first_post` and `post_step`: position of the first row and column, and their spacing, in posts of the extent.
  BlockDirections(const BlockExtent& extent, double first_post, double post_step, int side) {
    const auto n = static_cast<std::size_t>(side);
    for (auto& table : tables_) table.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      const double post = first_post + static_cast<double>(i) * post_step;
      // Ticks convert to degrees without rounding, so both sides of the date line get the same bits.
      const auto [sin_lat, cos_lat] =
          sine_cosine_of_deg(-90 + (extent.lat0 + post * extent.lat_step) / kTicksPerDegree);
      const auto [sin_lon, cos_lon] =
          sine_cosine_of_deg(-180 + (extent.lon0 + post * extent.lon_step) / kTicksPerDegree);
      tables_[0][i] = sin_lat;
      tables_[1][i] = cos_lat;
      tables_[2][i] = sin_lon;
      tables_[3][i] = cos_lon;
    }
    constexpr double kRadiansPerTick = kRadiansPerDegree / kTicksPerDegree;
    west_ = -std::numbers::pi + kRadiansPerTick * (extent.lon0 + first_post * extent.lon_step);
    step_ = kRadiansPerTick * post_step * extent.lon_step;
  }
  DirectionGrid grid() const { return {tables_[0], tables_[1], tables_[2], tables_[3], west_, step_}; }

 private:
  std::array<std::vector<double>, 4> tables_;
  double west_ = 0, step_ = 0;
};

}  // namespace selenograph::dem
