// Rows of shading normals, as vectors of whatever width the machine has: what shading_normals.h says of whole blocks.
#pragma once

#include <cstddef>

namespace selenograph::dem {

// Which posts a slope is taken from, and how.
enum class SlopeStencil {
  plane_3,   // least-squares plane through 3 x 3 posts
  plane_5,   // through 5 x 5
  sharpened  // of filtered heights: along a row and along a column, two posts to either side
};
// Of heights `step` apart, m per post: (6 (h[1] - h[-1]) - (h[2] - h[-2])) / 8.
inline double sharpened_slope(const float* here, std::ptrdiff_t step) {
  return static_cast<double>(6 * (here[step] - here[-step]) - (here[2 * step] - here[-2 * step])) / 8;
}

// Unit normals (MOON_ME) of a row of posts none of which, nor of those around, is missing. `centre`: the row's first
// height; the rows below and above lie `stride` away.
struct NormalRow {
  double cos_lat, sin_lat;
  const double *cos_lon, *sin_lon;  // of the columns
  double lat_step, lon_step;        // between posts, radians
};
void normals_of_row(const float* centre, int stride, int n, SlopeStencil stencil, const NormalRow& row, float* x,
                    float* y, float* z);

}  // namespace selenograph::dem
