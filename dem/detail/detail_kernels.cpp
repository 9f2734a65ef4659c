#include "dem/detail/detail_kernels.h"

#include <algorithm>
#include <cmath>

#include "dem/detail/crater_shape.h"
#include "dem/support/noise.h"
#include "dem/support/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dem/detail/detail_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::dem::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Places of one cell of the noise's lattice: its gradients are found once. Adds to the bit what perlin_noise gives.
void AddNoiseInCell(const NoisePlaces& places, std::uint32_t seed, double amplitude, double* HWY_RESTRICT heights) {
  const double *HWY_RESTRICT x = places.x, *HWY_RESTRICT y = places.y;
  const NoiseCell cell(lattice_floor(x[0]), lattice_floor(y[0]), lattice_floor(places.z), seed);
  const double i = cell.i, j = cell.j;
  const auto fz = static_cast<float>(places.z - cell.k), w = noise_fade(fz);
  float along_z[8];
  for (int c = 0; c < 8; ++c) along_z[c] = cell.z[c] * (fz - static_cast<float>(c >> 2));
  const std::size_t n = places.n;
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t c = 0; c < n; ++c) {
    const auto fx = static_cast<float>(x[c] - i), fy = static_cast<float>(y[c] - j);
    const float u = noise_fade(fx), v = noise_fade(fy);
    const auto corner = [&](int at, float dx, float dy)
                            SELENOGRAPH_INTO_LANES { return cell.x[at] * dx + cell.y[at] * dy + along_z[at]; };
    const auto along_x = [&](int at, float dy) SELENOGRAPH_INTO_LANES {
      return blend(corner(at, fx, dy), corner(at + 1, fx - 1, dy), u);
    };
    const float noise =
        blend(blend(along_x(0, fy), along_x(2, fy - 1), v), blend(along_x(4, fy), along_x(6, fy - 1), v), w);
    heights[c] += amplitude * static_cast<double>(noise);
  }
}

void AddNoise(const NoisePlaces& places, std::uint32_t seed, double amplitude, double* HWY_RESTRICT heights) {
  const double *HWY_RESTRICT x = places.x, *HWY_RESTRICT y = places.y;
  const double z = places.z;
  const std::size_t n = places.n;
  constexpr double kManyInCell = 1.0 / 12;  // steps from which on gradients cost less than finding who shares them
  if (n > 1 && std::abs(x[1] - x[0]) + std::abs(y[1] - y[0]) < kManyInCell) {
    for (std::size_t c = 0, past = 0; c < n; c = past) {
      const double i = lattice_floor(x[c]), j = lattice_floor(y[c]);
      for (past = c + 1; past < n && x[past] >= i && x[past] < i + 1 && y[past] >= j && y[past] < j + 1;) ++past;
      AddNoiseInCell({x + c, y + c, z, past - c}, seed, amplitude, heights + c);
    }
    return;
  }
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t c = 0; c < n; ++c)
    heights[c] += amplitude * static_cast<double>(perlin_noise<float>(x[c], y[c], z, seed));
}

HWY_INLINE double distance2(const CraterOverRow& crater, double x, double y) {
  const double dx = x - crater.x, dy = y - crater.y;
  return dx * dx + dy * dy + crater.along_axis2;
}

// In vectors by hand: compilers don't look up tables in vectors here. The last places are not enough for one.
void CastCrater(const CraterOverRow& crater, const RowUnderCrater& row, float* HWY_RESTRICT heights_m) {
  const CraterOverRow k = crater;
  const hn::ScalableTag<double> f64;
  const hn::Rebind<float, decltype(f64)> f32;
  const hn::Rebind<std::int32_t, decltype(f64)> i32;
  const std::size_t lanes = hn::Lanes(f64);
  std::size_t c = row.first;
  for (; c + lanes <= row.past_last; c += lanes) {
    const auto cos_lat = hn::Set(f64, row.cos_lat);
    const auto dx = hn::Sub(hn::Mul(cos_lat, hn::LoadU(f64, row.cos_lon + c)), hn::Set(f64, k.x)),
               dy = hn::Sub(hn::Mul(cos_lat, hn::LoadU(f64, row.sin_lon + c)), hn::Set(f64, k.y));
    const auto away2 = hn::Add(hn::Add(hn::Mul(dx, dx), hn::Mul(dy, dy)), hn::Set(f64, k.along_axis2));
    const auto reach2 = hn::Set(f64, k.reach2);
    if (hn::AllFalse(f64, hn::Lt(away2, reach2))) continue;
    const auto place = hn::Mul(hn::Sqrt(hn::Min(away2, reach2)), hn::Set(f64, k.steps));
    const auto i = hn::DemoteTo(i32, place);
    const auto f = hn::DemoteTo(f32, hn::Sub(place, hn::PromoteTo(f64, i)));
    const auto along = [&](const float* profile) HWY_ATTR {
      const auto low = hn::GatherIndex(f32, profile, i), high = hn::GatherIndex(f32, profile + 1, i);
      return hn::Add(low, hn::Mul(f, hn::Sub(high, low)));
    };
    const auto h = hn::Mul(hn::Set(f32, k.scale_m), hn::Add(hn::Mul(hn::Set(f32, 1 - k.share), along(k.younger)),
                                                            hn::Mul(hn::Set(f32, k.share), along(k.older))));
    const auto inside =
        hn::DemoteTo(f32, hn::Mul(hn::Sub(hn::Set(f64, k.reach_steps), place), hn::Set(f64, k.per_replaced)));
    const auto t = hn::Min(hn::Max(inside, hn::Zero(f32)), hn::Set(f32, 1));
    const auto replaced = hn::Mul(hn::Mul(t, t), hn::Sub(hn::Set(f32, 3), hn::Mul(hn::Set(f32, 2), t)));
    const auto before = hn::LoadU(f32, heights_m + c);
    const auto after = hn::Add(hn::Mul(before, hn::Sub(hn::Set(f32, 1), replaced)), h);
    // Beyond the reach the profile was looked up at its end.
    const auto within = hn::IfThenElseZero(hn::Lt(away2, reach2), hn::Set(f64, 1));
    const auto there = hn::Gt(hn::DemoteTo(f32, within), hn::Zero(f32));
    hn::StoreU(hn::IfThenElse(there, after, before), f32, heights_m + c);
  }
  for (; c < row.past_last; ++c) {
    const double away2 = distance2(k, row.cos_lat * row.cos_lon[c], row.cos_lat * row.sin_lon[c]);
    if (!(away2 < k.reach2)) continue;
    const double place = std::sqrt(away2) * k.steps;
    const auto i = static_cast<std::int32_t>(place);
    const auto f = static_cast<float>(place - i);
    const auto along = [&](const float* profile) { return profile[i] + f * (profile[i + 1] - profile[i]); };
    const float h = k.scale_m * ((1 - k.share) * along(k.younger) + k.share * along(k.older));
    const float replaced = CraterShape::replaced(static_cast<float>((k.reach_steps - place) * k.per_replaced));
    heights_m[c] = heights_m[c] * (1 - replaced) + h;
  }
}

void MarkCrater(const CraterOverRow& crater, const RowUnderCrater& row, double within2, float* HWY_RESTRICT marks) {
  const CraterOverRow k = crater;
  const double *HWY_RESTRICT sin_lon = row.sin_lon, *HWY_RESTRICT cos_lon = row.cos_lon;
  const double cos_lat = row.cos_lat;
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t c = row.first; c < row.past_last; ++c)
    marks[c] = distance2(k, cos_lat * cos_lon[c], cos_lat * sin_lon[c]) < within2 ? 1.F : marks[c];
}

}  // namespace selenograph::dem::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::dem {

HWY_EXPORT(AddNoise);
HWY_EXPORT(CastCrater);
HWY_EXPORT(MarkCrater);

void add_noise(const NoisePlaces& places, std::uint32_t seed, double amplitude, double* heights) {
  HWY_DYNAMIC_DISPATCH(AddNoise)(places, seed, amplitude, heights);
}

void cast_crater(const CraterOverRow& crater, const RowUnderCrater& row, float* heights_m) {
  HWY_DYNAMIC_DISPATCH(CastCrater)(crater, row, heights_m);
}

void mark_crater(const CraterOverRow& crater, const RowUnderCrater& row, double within2, float* marks) {
  HWY_DYNAMIC_DISPATCH(MarkCrater)(crater, row, within2, marks);
}

}  // namespace selenograph::dem
#endif
