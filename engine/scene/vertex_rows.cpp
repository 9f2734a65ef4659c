#include "engine/scene/vertex_rows.h"

#include <limits>

#include "dem/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/scene/vertex_rows.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

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

// axes: east, north, up, three numbers each. Comparisons with NaN are false: voids don't count.
void ExtendBox(const MeshVertex* row, int n, const RowPlace& place, const double* origin, const double* axes,
               double* low, double* high) {
  const hn::CappedTag<double, 8> d;
  const hn::Rebind<float, decltype(d)> f;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto extend_one = [&](int c) {
    const double radius = kMoonRadius_m + static_cast<double>(row[c].height_m), across = radius * place.cos_lat;
    const double x = across * place.cos_lon[c] - origin[0], y = across * place.sin_lon[c] - origin[1],
                 z = radius * place.sin_lat - origin[2];
    for (int k = 0; k < 3; ++k) {
      const double p = axes[3 * k] * x + axes[3 * k + 1] * y + axes[3 * k + 2] * z;
      low[k] = p < low[k] ? p : low[k], high[k] = p > high[k] ? p : high[k];
    }
  };
  int c = 0;
  if (n >= lanes) {
    auto low0 = hn::Set(d, low[0]), low1 = hn::Set(d, low[1]), low2 = hn::Set(d, low[2]), high0 = hn::Set(d, high[0]),
         high1 = hn::Set(d, high[1]), high2 = hn::Set(d, high[2]);
    for (; c + lanes <= n; c += lanes) {
      HWY_ALIGN float heights[8];
      for (int i = 0; i < lanes; ++i) heights[i] = row[c + i].height_m;
      const auto radius = hn::Add(hn::Set(d, kMoonRadius_m), hn::PromoteTo(d, hn::Load(f, heights)));
      const auto across = hn::Mul(radius, hn::Set(d, place.cos_lat));
      const auto x = hn::Sub(hn::Mul(across, hn::LoadU(d, place.cos_lon + c)), hn::Set(d, origin[0]));
      const auto y = hn::Sub(hn::Mul(across, hn::LoadU(d, place.sin_lon + c)), hn::Set(d, origin[1]));
      const auto z = hn::Sub(hn::Mul(radius, hn::Set(d, place.sin_lat)), hn::Set(d, origin[2]));
      const auto extend = [&](const double* axis, auto& lowest, auto& highest) HWY_ATTR {
        const auto p = hn::Add(hn::Add(hn::Mul(hn::Set(d, axis[0]), x), hn::Mul(hn::Set(d, axis[1]), y)),
                               hn::Mul(hn::Set(d, axis[2]), z));
        lowest = hn::IfThenElse(hn::Lt(p, lowest), p, lowest);
        highest = hn::IfThenElse(hn::Gt(p, highest), p, highest);
      };
      extend(axes, low0, high0), extend(axes + 3, low1, high1), extend(axes + 6, low2, high2);
    }
    low[0] = hn::GetLane(hn::MinOfLanes(d, low0)), high[0] = hn::GetLane(hn::MaxOfLanes(d, high0));
    low[1] = hn::GetLane(hn::MinOfLanes(d, low1)), high[1] = hn::GetLane(hn::MaxOfLanes(d, high1));
    low[2] = hn::GetLane(hn::MinOfLanes(d, low2)), high[2] = hn::GetLane(hn::MaxOfLanes(d, high2));
  }
  for (; c < n; ++c) extend_one(c);
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(PlaceRow);
HWY_EXPORT(ExtendBox);

void place_row(const MeshVertex* row, int n, const RowPlace& place, const Vec3& anchor_m, float* x, float* y,
               float* z) {
  HWY_DYNAMIC_DISPATCH(PlaceRow)(row, n, place, anchor_m.data(), x, y, z);
}

BoxAlong::BoxAlong(const Vec3& origin_m, const EastNorthUp& axes)
    : origin_(origin_m), axes_{axes.east, axes.north, axes.up} {
  low_.fill(std::numeric_limits<double>::infinity());
  high_.fill(-std::numeric_limits<double>::infinity());
}

void BoxAlong::extend(const MeshVertex* row, int n, const RowPlace& place) {
  HWY_DYNAMIC_DISPATCH(ExtendBox)(row, n, place, origin_.data(), axes_[0].data(), low_.data(), high_.data());
}

void BoxAlong::extend(const Vec3& vertex_m) {
  for (std::size_t k = 0; k < 3; ++k) {
    const double p = axes_[k].dot(vertex_m - origin_);
    low_[k] = p < low_[k] ? p : low_[k], high_[k] = p > high_[k] ? p : high_[k];
  }
}

}  // namespace selenograph::engine
#endif
