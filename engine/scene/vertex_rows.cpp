#include "engine/scene/vertex_rows.h"

#include "dem/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/scene/vertex_rows.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

void PlaceRow(const MeshVertex* row, int n, const RowPlace& place, const double* anchor, float* HWY_RESTRICT x,
              float* HWY_RESTRICT y, float* HWY_RESTRICT z) {
  const double cos_lat = place.cos_lat, sin_lat = place.sin_lat, ax = anchor[0], ay = anchor[1], az = anchor[2];
  const double *HWY_RESTRICT cos_lon = place.cos_lon, *HWY_RESTRICT sin_lon = place.sin_lon;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int c = 0; c < n; ++c) {
    const double radius = kMoonRadius_m + static_cast<double>(row[c].height_m), across = radius * cos_lat;
    x[c] = static_cast<float>(across * cos_lon[c] - ax);
    y[c] = static_cast<float>(across * sin_lon[c] - ay);
    z[c] = static_cast<float>(radius * sin_lat - az);
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(PlaceRow);

void place_row(const MeshVertex* row, int n, const RowPlace& place, const Vec3& anchor_m, float* x, float* y,
               float* z) {
  HWY_DYNAMIC_DISPATCH(PlaceRow)(row, n, place, anchor_m.data(), x, y, z);
}

}  // namespace selenograph::engine
#endif
