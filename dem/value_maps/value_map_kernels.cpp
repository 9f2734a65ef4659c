#include "dem/value_maps/value_map_kernels.h"

#include <cmath>
#include <cstdint>

#include "dem/grid/geodesy.h"
#include "dem/support/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dem/value_maps/value_map_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::dem::HWY_NAMESPACE {

std::uint32_t MeansWithinTexels(const MapTile& tile, const Footprints& f, double* values) {
  // ValueMap's two probes along a side lie 1 / sqrt(12) of it from the middle. Near the poles it has others.
  constexpr double kProbe = 0.28867513459481287, kWidest = 0.7, kLeastCosine = 0.2588190451025208;
  const double last_x = tile.columns - 2, last_y = tile.rows - 2;
  const double east_per_m = tile.per_deg_east / kMetresPerDegree, south_per_m = tile.per_deg_south / kMetresPerDegree;
  alignas(64) std::int32_t at[kFootprints];
  alignas(64) double fx[kFootprints], fy[kFootprints], twist[kFootprints];
  alignas(64) std::int64_t within[kFootprints];
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t i = 0; i < kFootprints; ++i) {
    const double x = (f.lon_deg[i] - tile.west_deg) * tile.per_deg_east,
                 y = (tile.north_deg - f.lat_deg[i]) * tile.per_deg_south;
    const double per_m = east_per_m / f.cos_lat[i];
    const double ax = f.a_east_m[i] * per_m, bx = f.b_east_m[i] * per_m, ay = f.a_north_m[i] * south_per_m,
                 by = f.b_north_m[i] * south_per_m;
    const double across = std::abs(ax) + std::abs(bx), down = std::abs(ay) + std::abs(by);
    // Numbers that mean nothing stay within the tile, too.
    double left = x > 0 ? x : 0, top = y > 0 ? y : 0;
    left = left < last_x ? left : last_x, top = top < last_y ? top : last_y;
    const auto column = static_cast<std::int32_t>(left), row = static_cast<std::int32_t>(top);
    const double u = x - column, v = y - row, wide = kProbe * across, high = kProbe * down;
    const bool inside = (u >= wide) & (1 - u >= wide) & (v >= high) & (1 - v >= high) & (across < kWidest) &
                        (down < kWidest) & (f.cos_lat[i] > kLeastCosine);
    within[i] = inside ? 1 : 0;
    at[i] = row * kMapTile + column;
    fx[i] = u, fy[i] = v, twist[i] = -(ax * ay + bx * by) / 12;  // y goes south
  }
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t i = 0; i < kFootprints; ++i) {
    const float* t = tile.texels + at[i];
    const double upper = static_cast<double>(t[0]), lower = static_cast<double>(t[kMapTile]);
    const double along_upper = static_cast<double>(t[1]) - upper,
                 along_lower = static_cast<double>(t[kMapTile + 1]) - lower;
    values[i] = (1 - fy[i]) * (upper + fx[i] * along_upper) + fy[i] * (lower + fx[i] * along_lower) +
                (along_lower - along_upper) * twist[i];
  }
  std::uint32_t found = 0;
  for (std::size_t i = 0; i < kFootprints; ++i)
    found |= static_cast<std::uint32_t>(within[i] != 0 && values[i] == values[i]) << i;
  return found;
}

}  // namespace selenograph::dem::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::dem {

HWY_EXPORT(MeansWithinTexels);

std::uint32_t means_within_texels(const MapTile& tile, const Footprints& footprints, double* values) {
  return HWY_DYNAMIC_DISPATCH(MeansWithinTexels)(tile, footprints, values);
}

}  // namespace selenograph::dem
#endif  // HWY_ONCE
