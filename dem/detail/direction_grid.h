// Grid of places on the sphere at which detail is evaluated.
#pragma once

#include <cstddef>
#include <span>

namespace selenograph::dem {

// Rows of equal latitude and columns of equal longitude, both ascending, no wider than a quarter of the globe: sines
// and cosines. Past a pole rows go on on the other side of the Moon, with a negative cosine.
struct DirectionGrid {
  std::span<const double> sin_lat, cos_lat, sin_lon, cos_lon;
  double west, lon_step;  // radians: the first column, and between columns
  std::size_t rows() const { return sin_lat.size(); }
  std::size_t columns() const { return sin_lon.size(); }
};

}  // namespace selenograph::dem
