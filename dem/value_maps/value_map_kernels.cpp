#include "dem/value_maps/value_map_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "dem/base/vector_targets.h"
#include "dem/grid/geodesy.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dem/value_maps/value_map_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::dem::HWY_NAMESPACE {

// ValueMap's two probes along a side lie 1 / sqrt(12) of it from the middle. Near the poles it has others.
constexpr double kProbe = 0.28867513459481287, kLeastCosine = 0.2588190451025208;

// A footprint in texels: x east, y south.
struct InTexels {
  double x, y, ax, ay, bx, by;
};
[[gnu::always_inline]] inline InTexels in_texels(const MapTile& tile, const Footprints& f, std::size_t i) {
  const double east_per_m = tile.per_deg_east / kMetresPerDegree, south_per_m = tile.per_deg_south / kMetresPerDegree;
  const double per_m = east_per_m / f.cos_lat[i];
  return {(f.lon_deg[i] - tile.west_deg) * tile.per_deg_east,
          (tile.north_deg - f.lat_deg[i]) * tile.per_deg_south,
          f.a_east_m[i] * per_m,
          -f.a_north_m[i] * south_per_m,
          f.b_east_m[i] * per_m,
          -f.b_north_m[i] * south_per_m};
}

// Places between four texels of a tile: the first one's index, and how far to the next ones.
struct Places {
  alignas(64) std::int32_t at[kFootprints];
  alignas(64) double u[kFootprints], v[kFootprints];
};
// Numbers that mean nothing are moved into the tile.
[[gnu::always_inline]] inline void place(const MapTile& tile, double x, double y, std::size_t i, Places& out) {
  const double last_x = tile.columns - 2, last_y = tile.rows - 2;
  double left = x > 0 ? x : 0, top = y > 0 ? y : 0;
  left = left < last_x ? left : last_x, top = top < last_y ? top : last_y;
  const auto column = static_cast<std::int32_t>(left), row = static_cast<std::int32_t>(top);
  out.at[i] = row * kMapTile + column;
  out.u[i] = x - column, out.v[i] = y - row;
}

// The map's bilinear values, plus `twist` times their xy term. (Texels are copied one by one: half the time that a
// vector's gathering takes.)
void Values(const float* texels, const Places& p, const double* twist, double* out) {
  alignas(64) float upper_left[kFootprints], upper_right[kFootprints], lower_left[kFootprints],
      lower_right[kFootprints];
  for (std::size_t i = 0; i < kFootprints; ++i) {
    const float* t = texels + p.at[i];
    upper_left[i] = t[0], upper_right[i] = t[1], lower_left[i] = t[kMapTile], lower_right[i] = t[kMapTile + 1];
  }
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t i = 0; i < kFootprints; ++i) {
    const auto upper = static_cast<double>(upper_left[i]), lower = static_cast<double>(lower_left[i]);
    const double along_upper = static_cast<double>(upper_right[i]) - upper,
                 along_lower = static_cast<double>(lower_right[i]) - lower;
    out[i] = (1 - p.v[i]) * (upper + p.u[i] * along_upper) + p.v[i] * (lower + p.u[i] * along_lower) +
             (along_lower - along_upper) * twist[i];
  }
}

// Of footprints that lie between several fours of texels: means of four probes. Those that `within` names keep their
// values.
void MeansOfProbes(const MapTile& tile, const Footprints& f, std::int64_t* within, double* values) {
  constexpr double kPoint2 = 0.05 * 0.05;  // ValueMap has one probe along shorter sides
  const double past_x = tile.columns - 1, past_y = tile.rows - 1;
  alignas(64) double sum[kFootprints] = {}, value[kFootprints];
  alignas(64) std::int64_t probed[kFootprints];
  const double none[kFootprints] = {};
  std::fill_n(probed, kFootprints, 1);
  Places places;
  for (int probe = 0; probe < 4; ++probe) {
    const double along_a = probe & 1 ? kProbe : -kProbe, along_b = probe & 2 ? kProbe : -kProbe;
    SELENOGRAPH_INDEPENDENT_LANES
    for (std::size_t i = 0; i < kFootprints; ++i) {
      const InTexels t = in_texels(tile, f, i);
      const double a2 = t.ax * t.ax + t.ay * t.ay, b2 = t.bx * t.bx + t.by * t.by;
      const double by_a = a2 < kPoint2 ? 0 : along_a, by_b = b2 < kPoint2 ? 0 : along_b;
      const double x = t.x + by_a * t.ax + by_b * t.bx, y = t.y + by_a * t.ay + by_b * t.by;
      const bool inside =
          (x >= 0) & (y >= 0) & (x < past_x) & (y < past_y) & (a2 <= 1) & (b2 <= 1) & (f.cos_lat[i] > kLeastCosine);
      probed[i] &= inside ? 1 : 0;
      place(tile, x, y, i, places);
    }
    Values(tile.texels, places, none, value);
    for (std::size_t i = 0; i < kFootprints; ++i) sum[i] += 0.25 * value[i];
  }
  for (std::size_t i = 0; i < kFootprints; ++i) values[i] = within[i] ? values[i] : sum[i], within[i] |= probed[i];
}

std::uint32_t SmallMeans(const MapTile& tile, const Footprints& f, std::uint32_t wanted, double* values) {
  constexpr double kWidest = 0.7;
  alignas(64) double twist[kFootprints];
  alignas(64) std::int64_t within[kFootprints];
  Places places;
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t i = 0; i < kFootprints; ++i) {
    const InTexels t = in_texels(tile, f, i);
    const double across = std::abs(t.ax) + std::abs(t.bx), down = std::abs(t.ay) + std::abs(t.by);
    place(tile, t.x, t.y, i, places);
    const double u = places.u[i], v = places.v[i], wide = kProbe * across, high = kProbe * down;
    const bool inside = (u >= wide) & (1 - u >= wide) & (v >= high) & (1 - v >= high) & (across < kWidest) &
                        (down < kWidest) & (f.cos_lat[i] > kLeastCosine);
    within[i] = inside ? 1 : 0;
    twist[i] = (t.ax * t.ay + t.bx * t.by) / 12;
  }
  Values(tile.texels, places, twist, values);
  const auto found = [&] {
    std::uint32_t bits = 0;
    for (std::size_t i = 0; i < kFootprints; ++i)
      bits |= static_cast<std::uint32_t>(within[i] != 0 && values[i] == values[i]) << i;
    return bits;
  };
  const std::uint32_t simple = found();
  if ((simple & wanted) == wanted) return simple;
  MeansOfProbes(tile, f, within, values);
  return found();
}

}  // namespace selenograph::dem::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::dem {

HWY_EXPORT(SmallMeans);

std::uint32_t small_means(const MapTile& tile, const Footprints& footprints, std::uint32_t wanted, double* values) {
  return HWY_DYNAMIC_DISPATCH(SmallMeans)(tile, footprints, wanted, values);
}

}  // namespace selenograph::dem
#endif  // HWY_ONCE
