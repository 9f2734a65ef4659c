#include "dem/posts/post_kernels.h"

#include <algorithm>
#include <cmath>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dem/posts/post_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::dem::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::ScalableTag<float>;
using Marks = hn::ScalableTag<std::uint32_t>;

// These functions implement those of post_kernels.h, for one vector target each. NaN lanes fail every comparison.
void ExtendRange(const float* h, int n, HeightRange& range) {
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  auto low = hn::Set(d, range.low), high = hn::Set(d, range.high);
  int i = 0;
  for (; i + lanes <= n; i += lanes) {
    const auto v = hn::LoadU(d, h + i);
    low = hn::IfThenElse(hn::Lt(v, low), v, low);
    high = hn::IfThenElse(hn::Gt(v, high), v, high);
  }
  float lowest = hn::GetLane(hn::MinOfLanes(d, low)), highest = hn::GetLane(hn::MaxOfLanes(d, high));
  for (; i < n; ++i) {
    if (h[i] < lowest) lowest = h[i];
    if (h[i] > highest) highest = h[i];
  }
  range = {lowest, highest};
}

float LargestDistance(const float* a, const float* b, int n, float worst) {
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  auto largest = hn::Set(d, worst);
  int i = 0;
  for (; i + lanes <= n; i += lanes) {
    const auto distance = hn::Abs(hn::Sub(hn::LoadU(d, a + i), hn::LoadU(d, b + i)));
    largest = hn::IfThenElse(hn::Gt(distance, largest), distance, largest);
  }
  worst = hn::GetLane(hn::MaxOfLanes(d, largest));
  for (; i < n; ++i)
    if (const float distance = std::abs(a[i] - b[i]); distance > worst) worst = distance;
  return worst;
}

void AddThreeRows(const float* below, const float* here, const float* above, int n, float* out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < n; ++i) out[i] = below[i] + 2 * here[i] + above[i];
}

constexpr float kToWholeNumbers =
    1.5F * (1 << 23);  // floats of this size are whole numbers: adding and subtracting it rounds to even

void HalveRow(const float* row, int n, float step, float* out) {
  const float per_m = 1 / step;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < n; ++i) {
    const float h = (row[2 * i - 1] + 2 * row[2 * i] + row[2 * i + 1]) / 16;
    out[i] = ((h * per_m + kToWholeNumbers) - kToWholeNumbers) * step;
  }
}

void QuantiseRow(const float* row, int n, float factor, float step, float* out) {
  const float per_m = 1 / step;
  for (int i = 0; i < n; ++i) out[i] = ((row[i] * factor * per_m + kToWholeNumbers) - kToWholeNumbers) * step;
}

void RefineRow(const float* a, int quads, float* out) {
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto half = hn::Set(d, 0.5F);
  int c = 0;
  for (; c + lanes <= quads; c += lanes) {
    const auto here = hn::LoadU(d, a + c), next = hn::LoadU(d, a + c + 1);
    hn::StoreInterleaved2(here, hn::Mul(hn::Add(here, next), half), d, out + 2 * c);
  }
  for (; c < quads; ++c) {
    out[2 * c] = a[c];
    out[2 * c + 1] = (a[c] + a[c + 1]) * 0.5F;
  }
  out[2 * quads] = a[quads];
}

void RefineBetweenRows(const float* a, const float* b, int quads, float* out) {
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto half = hn::Set(d, 0.5F);
  int c = 0;
  for (; c + lanes <= quads; c += lanes) {
    const auto above = hn::LoadU(d, b + c);
    hn::StoreInterleaved2(hn::Mul(hn::Add(hn::LoadU(d, a + c), above), half),
                          hn::Mul(hn::Add(hn::LoadU(d, a + c + 1), above), half), d, out + 2 * c);
  }
  for (; c < quads; ++c) {
    out[2 * c] = (a[c] + b[c]) * 0.5F;
    out[2 * c + 1] = (a[c + 1] + b[c]) * 0.5F;  // the diagonal's midpoint
  }
  out[2 * quads] = (a[quads] + b[quads]) * 0.5F;
}

int FillMissing(const float* layer, int n, SourceMark mark, float* heights, SourceMark* sources) {
  const Floats d;
  const Marks m;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto none = hn::Set(m, kNoSource), marks = hn::Set(m, mark);
  const auto lowest = hn::Set(d, kLowestRelief_m), highest = hn::Set(d, kHighestRelief_m);
  std::size_t filled = 0;
  int i = 0;
  for (; i + lanes <= n; i += lanes) {
    const auto v = hn::LoadU(d, layer + i);
    const auto was = hn::LoadU(m, sources + i);
    const auto missing = hn::RebindMask(d, hn::Eq(was, none));
    const auto possible = hn::And(hn::Ge(v, lowest), hn::Le(v, highest)), take = hn::And(missing, possible);
    filled += hn::CountTrue(d, take);
    hn::StoreU(hn::IfThenElse(take, v, hn::LoadU(d, heights + i)), d, heights + i);
    hn::StoreU(hn::IfThenElse(hn::RebindMask(m, take), marks, was), m, sources + i);
  }
  for (; i < n; ++i) {
    const float v = layer[i];
    if (sources[i] != kNoSource || !(v >= kLowestRelief_m && v <= kHighestRelief_m)) continue;
    heights[i] = v;
    sources[i] = mark;
    ++filled;
  }
  return static_cast<int>(filled);
}

// Sums in double, in the same order as the scalar loop. Where positions are denser than the row's posts, the taps of a
// vector's positions all lie within two vectors of the row: then table lookups pick them from these two.
void InterpolateRow(const float* row, [[maybe_unused]] int row_size, const RowTaps& taps, int n, double* out) {
  const auto scalar_loop = [&](int from, int past_last) {
    for (int i = from; i < past_last; ++i) {
      double sum = 0;
      for (int k = 0; k < 4; ++k)
        sum += taps.weights[static_cast<std::size_t>(k)][i] * static_cast<double>(row[taps.first[i] + k]);
      out[i] = sum;
    }
  };
  int i = 0;
#if HWY_TARGET != HWY_SCALAR
  const Floats f;
  const hn::Half<Floats> h;
  const hn::Repartition<double, Floats> d;
  const hn::Repartition<std::int32_t, Floats> s;
  const int lanes = static_cast<int>(hn::Lanes(f)), half = lanes / 2;
  for (; i + lanes <= n; i += lanes) {
    const int base = taps.first[i];
    if (taps.first[i + lanes - 1] + 4 > base + 2 * lanes || base + 2 * lanes > row_size) {
      scalar_loop(i, i + lanes);
      continue;
    }
    const auto a = hn::LoadU(f, row + base), b = hn::LoadU(f, row + base + lanes);
    const auto first_tap = hn::Sub(hn::LoadU(s, taps.first + i), hn::Set(s, base));  // index in the two vectors
    auto low = hn::Zero(d), high = hn::Zero(d);
    for (std::size_t k = 0; k < 4; ++k) {
      const auto tap = hn::Add(first_tap, hn::Set(s, static_cast<std::int32_t>(k)));
      const auto index = hn::IndicesFromVec(f, hn::And(tap, hn::Set(s, lanes - 1)));
      const auto in_second = hn::RebindMask(f, hn::Gt(tap, hn::Set(s, lanes - 1)));
      const auto post = hn::IfThenElse(in_second, hn::TableLookupLanes(b, index), hn::TableLookupLanes(a, index));
      const double* weight = taps.weights[k] + i;
      low = hn::Add(low, hn::Mul(hn::LoadU(d, weight), hn::PromoteTo(d, hn::LowerHalf(post))));
      high = hn::Add(high, hn::Mul(hn::LoadU(d, weight + half), hn::PromoteTo(d, hn::UpperHalf(h, post))));
    }
    hn::StoreU(low, d, out + i);
    hn::StoreU(high, d, out + i + half);
  }
#endif
  scalar_loop(i, n);
}

void AddFourRows(const std::array<const double*, 4>& rows, const std::array<double, 4>& weights, int n, float* out) {
  const double w0 = weights[0], w1 = weights[1], w2 = weights[2], w3 = weights[3];
  const double *a = rows[0], *b = rows[1], *c = rows[2], *e = rows[3];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < n; ++i) out[i] = static_cast<float>(w0 * a[i] + w1 * b[i] + w2 * c[i] + w3 * e[i]);
}

std::size_t CountEqual(const std::uint32_t* values, std::size_t n) {
  const Marks m;
  const std::size_t lanes = hn::Lanes(m);
  if (n == 0) return 0;
  const auto first = hn::Set(m, values[0]);
  std::size_t i = 0;
  for (; i + lanes <= n; i += lanes)
    if (const std::intptr_t mismatch = hn::FindFirstTrue(m, hn::Ne(hn::LoadU(m, values + i), first)); mismatch >= 0)
      return i + static_cast<std::size_t>(mismatch);
  while (i < n && values[i] == values[0]) ++i;
  return i;
}

}  // namespace selenograph::dem::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::dem {

HWY_EXPORT(ExtendRange);
HWY_EXPORT(LargestDistance);
HWY_EXPORT(AddThreeRows);
HWY_EXPORT(HalveRow);
HWY_EXPORT(QuantiseRow);
HWY_EXPORT(RefineRow);
HWY_EXPORT(RefineBetweenRows);
HWY_EXPORT(FillMissing);
HWY_EXPORT(InterpolateRow);
HWY_EXPORT(AddFourRows);
HWY_EXPORT(CountEqual);

void extend_range(const float* heights, int n, HeightRange& range) {
  HWY_DYNAMIC_DISPATCH(ExtendRange)(heights, n, range);
}
float largest_distance(const float* a, const float* b, int n, float worst) {
  return HWY_DYNAMIC_DISPATCH(LargestDistance)(a, b, n, worst);
}
void add_three_rows(const float* below, const float* here, const float* above, int n, float* out) {
  HWY_DYNAMIC_DISPATCH(AddThreeRows)(below, here, above, n, out);
}
void halve_row(const float* row, int n, float step, float* out) { HWY_DYNAMIC_DISPATCH(HalveRow)(row, n, step, out); }
void quantise_row(const float* row, int n, float factor, float step, float* out) {
  HWY_DYNAMIC_DISPATCH(QuantiseRow)(row, n, factor, step, out);
}
void refine_row(const float* a, int quads, float* out) { HWY_DYNAMIC_DISPATCH(RefineRow)(a, quads, out); }
void refine_between_rows(const float* a, const float* b, int quads, float* out) {
  HWY_DYNAMIC_DISPATCH(RefineBetweenRows)(a, b, quads, out);
}
int fill_missing(const float* layer, int n, SourceMark mark, float* heights, SourceMark* sources) {
  return HWY_DYNAMIC_DISPATCH(FillMissing)(layer, n, mark, heights, sources);
}
void interpolate_row(const float* row, int row_size, const RowTaps& taps, int n, double* out) {
  HWY_DYNAMIC_DISPATCH(InterpolateRow)(row, row_size, taps, n, out);
}
void add_four_rows(const std::array<const double*, 4>& rows, const std::array<double, 4>& weights, int n, float* out) {
  HWY_DYNAMIC_DISPATCH(AddFourRows)(rows, weights, n, out);
}
std::size_t count_equal(const std::uint32_t* values, std::size_t n) {
  return HWY_DYNAMIC_DISPATCH(CountEqual)(values, n);
}

}  // namespace selenograph::dem
#endif  // HWY_ONCE
