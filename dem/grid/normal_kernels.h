// Vectorised computation of shading normals, row by row; see shading_normals.h.
#pragma once

#include <cstddef>

namespace selenograph::dem {

// Stencil of a slope.
enum class SlopeStencil {
  plane_3,   // least-squares plane through 3 x 3 posts
  plane_5,   // least-squares plane through 5 x 5 posts
  sharpened  // for filtered heights: differences along the row and the column, two posts to either side
};
// Returns the slope from heights `step` apart, m per post: (6 (h[1] - h[-1]) - (h[2] - h[-2])) / 8.
inline double sharpened_slope(const float* h, std::ptrdiff_t step) {
  return static_cast<double>(6 * (h[step] - h[-step]) - (h[2 * step] - h[-2 * step])) / 8;
}

// Position of a row of posts.
struct NormalRow {
  double cos_lat, sin_lat;
  const double *cos_lon, *sin_lon;  // by column
  double lat_step, lon_step;        // spacing of posts, radians
  double base_radius_m;             // distance from the Moon's centre at height 0
};
// Computes unit normals (MOON_ME) of a row of `n` posts without voids in or around it. `centre`: the row's first
// height; adjacent rows are `stride` apart.
void normals_of_row(const float* centre, int stride, int n, SlopeStencil stencil, const NormalRow& row, float* x,
                    float* y, float* z);

}  // namespace selenograph::dem
