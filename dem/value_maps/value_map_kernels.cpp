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

// Distance of ValueMap's two probes from the middle of a side, over the side: 1 / sqrt(12). Below the cosine of
// kPolar_deg, ValueMap places probes differently, and these kernels do not apply.
constexpr double kProbe = 0.28867513459481287, kMinCosine = 0.2588190451025208;

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

// Positions in squares of four texels: the index of the north-western texel, and the offset from it, 0 to 1.
struct SquarePositions {
  alignas(64) std::int32_t at[kFootprints];
  alignas(64) double u[kFootprints];
  alignas(64) double v[kFootprints];
};
// Locates a position in texels. Clamps the square into the tile: undefined entries must not read outside of it.
[[gnu::always_inline]] inline void locate_square(const MapTile& tile, double x, double y, std::size_t i,
                                                 SquarePositions& out) {
  const double last_x = tile.columns - 2, last_y = tile.rows - 2;
  double left = x > 0 ? x : 0, top = y > 0 ? y : 0;
  left = left < last_x ? left : last_x;
  top = top < last_y ? top : last_y;
  const auto column = static_cast<std::int32_t>(left), row = static_cast<std::int32_t>(top);
  out.at[i] = row * kMapTile + column;
  out.u[i] = x - column;
  out.v[i] = y - row;
}

// Computes the map's bilinear values plus `twist` times their xy term. Copies texels one by one, which takes half the
// time of a vector gather.
void Values(const float* texels, const SquarePositions& p, const double* twist, double* out) {
  alignas(64) float upper_left[kFootprints], upper_right[kFootprints], lower_left[kFootprints],
      lower_right[kFootprints];
  for (std::size_t i = 0; i < kFootprints; ++i) {
    const float* t = texels + p.at[i];
    upper_left[i] = t[0];
    upper_right[i] = t[1];
    lower_left[i] = t[kMapTile];
    lower_right[i] = t[kMapTile + 1];
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

// Computes means of four probes, for footprints across several squares. Footprints marked in `has_mean` keep their
// values; marks the others whose probes lie in the tile.
void MeansOfProbes(const MapTile& tile, const Footprints& f, std::int64_t* has_mean, double* values) {
  constexpr double kPoint2 = 0.05 * 0.05;  // squared length of sides below which ValueMap has one probe
  const double past_x = tile.columns - 1, past_y = tile.rows - 1;
  alignas(64) double sum[kFootprints] = {};
  alignas(64) double value[kFootprints];
  alignas(64) std::int64_t probed[kFootprints];
  const double none[kFootprints] = {};
  std::fill_n(probed, kFootprints, 1);
  SquarePositions positions;
  for (int probe = 0; probe < 4; ++probe) {
    const double along_a = probe & 1 ? kProbe : -kProbe, along_b = probe & 2 ? kProbe : -kProbe;
    SELENOGRAPH_INDEPENDENT_LANES
    for (std::size_t i = 0; i < kFootprints; ++i) {
      const InTexels t = in_texels(tile, f, i);
      const double a2 = t.ax * t.ax + t.ay * t.ay, b2 = t.bx * t.bx + t.by * t.by;
      const double by_a = a2 < kPoint2 ? 0 : along_a, by_b = b2 < kPoint2 ? 0 : along_b;
      const double x = t.x + by_a * t.ax + by_b * t.bx, y = t.y + by_a * t.ay + by_b * t.by;
      const bool inside =
          (x >= 0) & (y >= 0) & (x < past_x) & (y < past_y) & (a2 <= 1) & (b2 <= 1) & (f.cos_lat[i] > kMinCosine);
      probed[i] &= inside ? 1 : 0;
      locate_square(tile, x, y, i, positions);
    }
    Values(tile.texels, positions, none, value);
    for (std::size_t i = 0; i < kFootprints; ++i) sum[i] += 0.25 * value[i];
  }
  for (std::size_t i = 0; i < kFootprints; ++i) {
    values[i] = has_mean[i] ? values[i] : sum[i];
    has_mean[i] |= probed[i];
  }
}

// Implements small_means(). A footprint that lies in one square of four texels has a closed form: the bilinear value at
// its middle plus the covariance of its x and y times the square's xy term. Others are probed.
std::uint32_t SmallMeans(const MapTile& tile, const Footprints& f, std::uint32_t requested, double* values) {
  constexpr double kMaxSize = 0.7;  // extent of a footprint in texels for which one square may be enough
  alignas(64) double twist[kFootprints];
  alignas(64) std::int64_t has_mean[kFootprints];
  SquarePositions positions;
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t i = 0; i < kFootprints; ++i) {
    const InTexels t = in_texels(tile, f, i);
    const double across = std::abs(t.ax) + std::abs(t.bx), down = std::abs(t.ay) + std::abs(t.by);
    locate_square(tile, t.x, t.y, i, positions);
    const double u = positions.u[i], v = positions.v[i], wide = kProbe * across, high = kProbe * down;
    const bool inside = (u >= wide) & (1 - u >= wide) & (v >= high) & (1 - v >= high) & (across < kMaxSize) &
                        (down < kMaxSize) & (f.cos_lat[i] > kMinCosine);
    has_mean[i] = inside ? 1 : 0;
    twist[i] = (t.ax * t.ay + t.bx * t.by) / 12;
  }
  Values(tile.texels, positions, twist, values);
  // Returns a bit per footprint that has a mean which is not NaN (no data).
  const auto found = [&] {
    std::uint32_t bits = 0;
    for (std::size_t i = 0; i < kFootprints; ++i)
      bits |= static_cast<std::uint32_t>(has_mean[i] != 0 && values[i] == values[i]) << i;
    return bits;
  };
  const std::uint32_t in_one_square = found();
  if ((in_one_square & requested) == requested) return in_one_square;
  MeansOfProbes(tile, f, has_mean, values);
  return found();
}

}  // namespace selenograph::dem::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::dem {

HWY_EXPORT(SmallMeans);

std::uint32_t small_means(const MapTile& tile, const Footprints& footprints, std::uint32_t requested, double* values) {
  return HWY_DYNAMIC_DISPATCH(SmallMeans)(tile, footprints, requested, values);
}

}  // namespace selenograph::dem
#endif  // HWY_ONCE
