#include "dem/detail/detail_kernels.h"

#include <algorithm>
#include <cmath>

#include "dem/noise.h"
#include "dem/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dem/detail/detail_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::dem::HWY_NAMESPACE {

void AddNoise(const NoisePlaces& places, std::uint32_t seed, double amplitude, double* HWY_RESTRICT heights) {
  const double *HWY_RESTRICT x = places.x, *HWY_RESTRICT y = places.y;
  const double z = places.z;
  const std::size_t n = places.n;
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t c = 0; c < n; ++c)
    heights[c] += amplitude * static_cast<double>(perlin_noise<float>(x[c], y[c], z, seed));
}

HWY_INLINE double distance2(const CraterOverRow& crater, double x, double y) {
  const double dx = x - crater.x, dy = y - crater.y;
  return dx * dx + dy * dy + crater.along_axis2;
}

void CastCrater(const CraterOverRow& crater, const RowPlaces& row, float* HWY_RESTRICT lowest_m,
                float* HWY_RESTRICT highest_m) {
  const CraterOverRow k = crater;
  const double *HWY_RESTRICT sin_lon = row.sin_lon, *HWY_RESTRICT cos_lon = row.cos_lon;
  const float *HWY_RESTRICT younger = k.younger, *HWY_RESTRICT older = k.older;
  const double cos_lat = row.cos_lat;
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t c = row.first; c < row.past_last; ++c) {
    const double away2 = distance2(k, cos_lat * cos_lon[c], cos_lat * sin_lon[c]);
    // Beyond the reach the profile is looked up at its end, and not used.
    const double place = std::sqrt(away2 < k.reach2 ? away2 : k.reach2) * k.steps;
    const auto i = static_cast<std::int32_t>(place);
    const auto f = static_cast<float>(place - i);
    const float a = younger[i] + f * (younger[i + 1] - younger[i]), b = older[i] + f * (older[i + 1] - older[i]);
    const float h = away2 < k.reach2 ? k.scale_m * ((1 - k.share) * a + k.share * b) : 0.F;
    lowest_m[c] = lowest_m[c] < h ? lowest_m[c] : h;
    highest_m[c] = highest_m[c] > h ? highest_m[c] : h;
  }
}

void MarkCrater(const CraterOverRow& crater, const RowPlaces& row, double within2, float* HWY_RESTRICT marks) {
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

void cast_crater(const CraterOverRow& crater, const RowPlaces& row, float* lowest_m, float* highest_m) {
  HWY_DYNAMIC_DISPATCH(CastCrater)(crater, row, lowest_m, highest_m);
}

void mark_crater(const CraterOverRow& crater, const RowPlaces& row, double within2, float* marks) {
  HWY_DYNAMIC_DISPATCH(MarkCrater)(crater, row, within2, marks);
}

}  // namespace selenograph::dem
#endif
