// Grid of positions on the sphere at which detail is evaluated.
#pragma once

#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

namespace selenograph::dem {

// Sines and cosines of rows of equal latitude and columns of equal longitude, both ascending, no wider than a quarter
// of the globe. Rows beyond a pole continue on the opposite meridian, where cos(latitude) is negative.
struct DirectionGrid {
  std::span<const double> sin_lat, cos_lat, sin_lon, cos_lon;
  double west, lon_step;  // longitude of the first column and spacing of columns, radians
  std::size_t rows() const { return sin_lat.size(); }
  std::size_t columns() const { return sin_lon.size(); }
};

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

}  // namespace selenograph::dem
