#include "dem/grid/normal_kernels.h"

#include <cmath>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dem/grid/normal_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::dem::HWY_NAMESPACE {

struct PlaneSlopes {
  double along_row, along_column;  // m per post
};

// Returns the slopes at a post. Without voids, the least-squares plane needs only the sums of dx h and dy h.
template <SlopeStencil kStencil>
HWY_INLINE PlaneSlopes SlopesAt(const float* centre, int stride) {
  if constexpr (kStencil == SlopeStencil::sharpened) {
    return {sharpened_slope(centre, 1), sharpened_slope(centre, stride)};
  } else {
    constexpr int kReach = kStencil == SlopeStencil::plane_3 ? 1 : 2;
    constexpr double kSum = kReach == 1 ? 6 : 50;  // sum of dx^2 over the posts
    float along_row = 0, along_column = 0;
    for (int dy = -kReach; dy <= kReach; ++dy)
      for (int dx = -kReach; dx <= kReach; ++dx) {
        const float h = centre[dy * stride + dx] - *centre;
        along_row += static_cast<float>(dx) * h;
        along_column += static_cast<float>(dy) * h;
      }
    return {static_cast<double>(along_row) / kSum, static_cast<double>(along_column) / kSum};
  }
}

// Computes normals by one stencil: up - slope to the east * east - slope to the north * north, normalised.
template <SlopeStencil kStencil>
void NormalsBy(const float* centre, int stride, int n, const NormalRow& row, float* HWY_RESTRICT x,
               float* HWY_RESTRICT y, float* HWY_RESTRICT z) {
  const double cos_lat = row.cos_lat, sin_lat = row.sin_lat, lat_step = row.lat_step, lon_step = row.lon_step,
               base_radius_m = row.base_radius_m;
  const double *HWY_RESTRICT cos_lons = row.cos_lon, *HWY_RESTRICT sin_lons = row.sin_lon;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int c = 0; c < n; ++c) {
    const PlaneSlopes slopes = SlopesAt<kStencil>(centre + c, stride);
    const double radius = base_radius_m + static_cast<double>(centre[c]);
    // Slopes on the ground, m per m: divide by the length of a post's spacing.
    const double to_east = slopes.along_row / (radius * cos_lat * lon_step),
                 to_north = slopes.along_column / (radius * lat_step);
    const double cos_lon = cos_lons[c], sin_lon = sin_lons[c];
    const double nx = cos_lat * cos_lon + sin_lon * to_east + sin_lat * cos_lon * to_north,
                 ny = cos_lat * sin_lon - cos_lon * to_east + sin_lat * sin_lon * to_north,
                 nz = sin_lat - cos_lat * to_north;
    const double length = std::sqrt(nx * nx + (ny * ny + nz * nz));
    x[c] = static_cast<float>(nx / length);
    y[c] = static_cast<float>(ny / length);
    z[c] = static_cast<float>(nz / length);
  }
}

void NormalsOfRow(const float* centre, int stride, int n, SlopeStencil stencil, const NormalRow& row, float* x,
                  float* y, float* z) {
  switch (stencil) {
    case SlopeStencil::plane_3:
      return NormalsBy<SlopeStencil::plane_3>(centre, stride, n, row, x, y, z);
    case SlopeStencil::plane_5:
      return NormalsBy<SlopeStencil::plane_5>(centre, stride, n, row, x, y, z);
    case SlopeStencil::sharpened:
      return NormalsBy<SlopeStencil::sharpened>(centre, stride, n, row, x, y, z);
  }
}

}  // namespace selenograph::dem::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::dem {

HWY_EXPORT(NormalsOfRow);

void normals_of_row(const float* centre, int stride, int n, SlopeStencil stencil, const NormalRow& row, float* x,
                    float* y, float* z) {
  HWY_DYNAMIC_DISPATCH(NormalsOfRow)(centre, stride, n, stencil, row, x, y, z);
}

}  // namespace selenograph::dem
#endif  // HWY_ONCE
