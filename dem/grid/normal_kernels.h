// Vectorised computation of shading normals, row by row; see shading_normals.h.
#pragma once

#include <cstddef>

namespace selenograph::dem {

// Stencil of a slope.
enum class SlopeStencil {
  plane_3,   // least-squares plane through 3 x 3 posts
  plane_5,   // through 5 x 5
  sharpened  // of filtered heights: along a row and along a column, two posts to either side
};
// Slope from heights `step` apart, m per post: (6 (h[1] - h[-1]) - (h[2] - h[-2])) / 8.
inline double sharpened_slope(const float* here, std::ptrdiff_t step) {
  return static_cast<double>(6 * (here[step] - here[-step]) - (here[2 * step] - here[-2 * step])) / 8;
}

// Unit normals (MOON_ME) of a row of posts without no-data in or around it. `centre`: the row's first height;
// neighbouring rows are `stride` away.
struct NormalRow {
  double cos_lat, sin_lat;
  const double *cos_lon, *sin_lon;  // of the columns
  double lat_step, lon_step;        // between posts, radians
};
void normals_of_row(const float* centre, int stride, int n, SlopeStencil stencil, const NormalRow& row, float* x,
                    float* y, float* z);

}  // namespace selenograph::dem
