#include "dem/detail/detail_kernels.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "dem/base/noise.h"
#include "dem/base/vector_targets.h"
#include "dem/detail/crater_shape.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dem/detail/detail_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::dem::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

#if HWY_TARGET == HWY_SCALAR

void AddNoise(const NoiseRow& row, std::uint32_t seed, double amplitude, double* HWY_RESTRICT heights) {
  for (std::size_t c = 0; c < row.n; ++c)
    heights[c] += amplitude * static_cast<double>(perlin_noise<float>(row.x[c], row.y[c], row.z, seed));
}

#else

// Evaluates perlin_noise<float> for one vector of positions, to the bit. It is vectorised by hand: compilers' code
// takes twice the time.
//
//      along x: blend by fade(x)      in_plane(dz = 0 and 1): blend four corner gradients
//      c2 ---- c3                     at: blend the two planes by w_ = fade(z)
//      |  . P   |   gradient . (P - corner) at each of the eight corners
//      c0 ---- c1
class Noise {
  using F32 = hn::ScalableTag<float>;
  using F64 = hn::RepartitionToWide<F32>;
  using I32 = hn::RebindToSigned<F32>;
  using U32 = hn::RebindToUnsigned<F32>;
  using Floats = hn::Vec<F32>;
  using Bits = hn::Vec<U32>;

 public:
  // `z`: the coordinate that all positions share, in cells. `close`: most vectors have all positions in one cell of the
  // noise's lattice. Their eight gradients are then computed once per cell (in_cell) instead of per position
  // (in_plane).
  Noise(double z, std::uint32_t seed, bool close)
      : k_(lattice_floor(z)), seed_(seed), close_(close), fz_(static_cast<float>(z - k_)), w_(noise_fade(fz_)) {
    for (int d = 0; d < 2; ++d) along_z_[d] = seed ^ (static_cast<std::uint32_t>(k_ + d) * kLatticeZ);
  }

  // Returns the noise at the positions (x[i], y[i], z), in cells.
  HWY_INLINE Floats at(const double* HWY_RESTRICT x, const double* HWY_RESTRICT y) {
    const Axis u(x, kLatticeX), v(y, kLatticeY);
    if (close_) {
      const I32 i32;
      const std::int32_t i = hn::GetLane(u.cell), j = hn::GetLane(v.cell);
      if (hn::AllTrue(i32, hn::And(hn::Eq(u.cell, hn::Set(i32, i)), hn::Eq(v.cell, hn::Set(i32, j))))) {
        if (!cell_ || i != cell_->i || j != cell_->j) cell_.emplace(i, j, k_, seed_);
        return blend(in_cell(u, v, 0), in_cell(u, v, 1), hn::Set(F32(), w_));
      }
    }
    return blend(in_plane(u, v, 0), in_plane(u, v, 1), hn::Set(F32(), w_));
  }

 private:
  static HWY_INLINE Floats blend(Floats a, Floats b, Floats t) { return hn::Add(a, hn::Mul(t, hn::Sub(b, a))); }

  // One coordinate of the positions: their cells, their offsets from both sides of the cell (`into`), the sides' terms
  // of the lattice hash, and the blending weight.
  struct Axis {
    HWY_INLINE Axis(const double* HWY_RESTRICT coordinates, std::uint32_t factor) {
      const F32 f32;
      const F64 f64;
      const hn::Half<F32> half;
      const hn::RebindToSigned<hn::Half<F32> > half_i32;
      const auto low = hn::LoadU(f64, coordinates), high = hn::LoadU(f64, coordinates + hn::Lanes(f64));
      const auto low_cell = hn::Floor(low), high_cell = hn::Floor(high);
      into[0] =
          hn::Combine(f32, hn::DemoteTo(half, hn::Sub(high, high_cell)), hn::DemoteTo(half, hn::Sub(low, low_cell)));
      into[1] = hn::Sub(into[0], hn::Set(f32, 1));
      cell =
          hn::Combine(hn::RebindToSigned<F32>(), hn::DemoteTo(half_i32, high_cell), hn::DemoteTo(half_i32, low_cell));
      hash[0] = hn::Mul(hn::BitCast(U32(), cell), hn::Set(U32(), factor));
      hash[1] = hn::Add(hash[0], hn::Set(U32(), factor));
      const Floats t = into[0], inner = hn::Add(hn::Mul(t, hn::Sub(hn::Mul(t, hn::Set(f32, 6)), hn::Set(f32, 15))),
                                                hn::Set(f32, 10));
      fade = hn::Mul(hn::Mul(hn::Mul(t, t), t), inner);
    }
    Floats into[2], fade;
    hn::Vec<I32> cell;
    Bits hash[2];
  };

  // Returns the blend of the four corners in the lattice plane k_ + dz, with gradients computed per position.
  HWY_INLINE Floats in_plane(const Axis& x, const Axis& y, int dz) const {
    const Floats z = hn::Set(F32(), fz_ - static_cast<float>(dz));
    const Bits along_z = hn::Set(U32(), along_z_[dz]);
    const auto along_x = [&](int dy) HWY_ATTR {
      const Bits rest = hn::Xor(y.hash[dy], along_z);
      return blend(along_gradient(hash(hn::Xor(x.hash[0], rest)), x.into[0], y.into[dy], z),
                   along_gradient(hash(hn::Xor(x.hash[1], rest)), x.into[1], y.into[dy], z), x.fade);
    };
    return blend(along_x(0), along_x(1), y.fade);
  }

  // Returns the same blend for positions that all lie in one cell, whose gradients are in cell_.
  HWY_INLINE Floats in_cell(const Axis& x, const Axis& y, int dz) const {
    const F32 f32;
    const auto corner = [&](int dx, int dy) HWY_ATTR {
      const int c = dx + 2 * dy + 4 * dz;
      const float along_z = cell_->z[c] * (fz_ - static_cast<float>(dz));
      return hn::Add(
          hn::Add(hn::Mul(hn::Set(f32, cell_->x[c]), x.into[dx]), hn::Mul(hn::Set(f32, cell_->y[c]), y.into[dy])),
          hn::Set(f32, along_z));
    };
    return blend(blend(corner(0, 0), corner(1, 0), x.fade), blend(corner(0, 1), corner(1, 1), x.fade), y.fade);
  }

  // Returns lattice_hash (noise.h). Only its four highest bits are used.
  static HWY_INLINE Bits hash(Bits h) {
    h = hn::Mul(hn::Xor(h, hn::ShiftRight<15>(h)), hn::Set(U32(), kLatticeFirst));
    return hn::Mul(hn::Xor(h, hn::ShiftRight<12>(h)), hn::Set(U32(), kLatticeThen));
  }

  // Returns (x, y, z) . g, where g is the one of Perlin's twelve gradients (two components +-1, one 0) that the four
  // highest bits of the hash number; to the bit along_gradient of noise.h. By number:
  //
  //   0-3: +-x +-y    4-7: +-x +-z    8-11: +-y +-z    12-15: x + y, -x + y, -y + z, -y - z (again)
  //
  // The bits index 16-byte tables, whose entries become sign bits of the lanes: kFirst and kSecond select a coordinate
  // (x or y, y or z), the two Minus tables negate it. M: the sign bit.
  static HWY_INLINE Floats along_gradient(Bits h, Floats x, Floats y, Floats z) {
    const F32 f32;
    alignas(16) static constexpr std::uint8_t kFirst[16]{0, 0, 0, 0, 0, 0, 0, 0, M, M, M, M, 0, 0, M, M},
        kSecond[16]{0, 0, 0, 0, M, M, M, M, M, M, M, M, 0, 0, M, M},
        kFirstMinus[16]{0, M, 0, M, 0, M, 0, M, 0, M, 0, M, 0, M, M, M},
        kSecondMinus[16]{0, 0, M, M, 0, 0, M, M, 0, 0, M, M, 0, 0, 0, M};
    // The number comes into the highest byte of each lane. The other bytes look up entry 0, which is 0 in every table.
    const Bits number = hn::And(hn::ShiftRight<4>(h), hn::Set(U32(), 0x0F000000U));
    const auto looked_up = [&](const std::uint8_t* table) HWY_ATTR {
      const hn::Repartition<std::uint8_t, F32> bytes;
      return hn::TableLookupBytes(hn::LoadDup128(bytes, table), hn::BitCast(bytes, number));
    };
    // Compare instead of using IfNegativeThenElse, which with SSSE3 tests more than the sign (Highway 1.0.3).
    const auto chosen = [&](const std::uint8_t* table, Floats yes, Floats no) HWY_ATTR {
      const auto negative = hn::Lt(hn::BitCast(I32(), looked_up(table)), hn::Zero(I32()));
      return hn::IfThenElse(hn::RebindMask(f32, negative), yes, no);
    };
    const auto minus = [&](const std::uint8_t* table) HWY_ATTR { return hn::BitCast(f32, looked_up(table)); };
    return hn::Add(hn::Xor(chosen(kFirst, y, x), minus(kFirstMinus)),
                   hn::Xor(chosen(kSecond, z, y), minus(kSecondMinus)));
  }
  static constexpr std::uint8_t M = 0x80;

  std::int32_t k_;                   // lattice plane below z
  std::uint32_t seed_, along_z_[2];  // seed; its hash with the planes k_ and k_ + 1
  bool close_;
  float fz_, w_;                   // z above plane k_, and the weight of plane k_ + 1
  std::optional<NoiseCell> cell_;  // gradients of the latest cell
};

void AddNoise(const NoiseRow& row, std::uint32_t seed, double amplitude, double* HWY_RESTRICT heights) {
  const hn::ScalableTag<float> f32;
  const hn::RepartitionToWide<decltype(f32)> f64;
  const std::size_t lanes = hn::Lanes(f32), half = hn::Lanes(f64);
  constexpr double kClose = 1.0 / 24;  // spacing in cells below which most vectors lie in one cell (`close`)
  const double *x0 = row.x, *y0 = row.y;
  Noise noise(row.z, seed, row.n > 1 && std::abs(x0[1] - x0[0]) + std::abs(y0[1] - y0[0]) < kClose);
  const auto add = [&](const double* x, const double* y, double* to) HWY_ATTR {
    const auto values = noise.at(x, y);
    const auto scaled = [&](auto floats)
                            HWY_ATTR { return hn::Mul(hn::Set(f64, amplitude), hn::PromoteTo(f64, floats)); };
    hn::StoreU(hn::Add(hn::LoadU(f64, to), scaled(hn::LowerHalf(values))), f64, to);
    hn::StoreU(hn::Add(hn::LoadU(f64, to + half), scaled(hn::UpperHalf(hn::Half<decltype(f32)>(), values))), f64,
               to + half);
  };
  std::size_t c = 0;
  for (; c + lanes <= row.n; c += lanes) add(row.x + c, row.y + c, heights + c);
  if (c == row.n) return;
  // Pad the remaining positions to a full vector.
  constexpr std::size_t kMaxLanes = HWY_MAX_BYTES / sizeof(float);
  double x[kMaxLanes] = {}, y[kMaxLanes] = {}, rest[kMaxLanes] = {};
  const std::size_t left = row.n - c;
  std::copy_n(row.x + c, left, x);
  std::copy_n(row.y + c, left, y);
  std::copy_n(heights + c, left, rest);
  add(x, y, rest);
  std::copy_n(rest, left, heights + c);
}

#endif

// Returns the squared chord from the crater's centre to a position of the row, (x, y) in the equatorial plane.
HWY_INLINE double distance2(const CraterOverRow& crater, double x, double y) {
  const double dx = x - crater.x, dy = y - crater.y;
  return dx * dx + dy * dy + crater.along_axis2;
}

// Shortest distance in profile steps by which an offset is divided: the middle of a crater has no direction.
constexpr float kMinSteps = 1e-6F;

// Returns the profile step of a position (x, y) of the row at `step` from the centre, as the outline has it
// (CraterOutline::round).
HWY_INLINE double round_step(const CraterOverRow& crater, double x, double y, double step) {
  const double dx = x - crater.x, dy = y - crater.y;
  const float distance = std::max(static_cast<float>(step), kMinSteps);
  const float east = static_cast<float>((dx * crater.east_x + dy * crater.east_y) * crater.steps) / distance;
  const float north =
      static_cast<float>((dx * crater.north_x + dy * crater.north_y + crater.north_along_axis) * crater.steps) /
      distance;
  const float fade = std::min(static_cast<float>((crater.reach_steps - step) * crater.per_faded), 1.F);
  return step * static_cast<double>(1 - fade * crater.outline->wave(east, north));
}

// Implements cast_crater(). Vectorised by hand, because compilers do not vectorise the lookups in the profiles. For
// each position: squared chord to the crater's centre, step of the profile by the outline, with its fraction, height
// between the younger and the older profile, and the share of older ground that it replaces. A scalar loop finishes the
// positions that do not fill a vector; it rounds like the vectors.
void CastCrater(const CraterOverRow& crater, const RowUnderCrater& row, float* HWY_RESTRICT heights_m) {
  const CraterOverRow k = crater;
  const hn::ScalableTag<double> f64;
  const hn::Rebind<float, decltype(f64)> f32;
  const hn::Rebind<std::int32_t, decltype(f64)> i32;
  const std::size_t lanes = hn::Lanes(f64);
  const auto f32_one = hn::Set(f32, 1);
  std::size_t c = row.first;
  for (; c + lanes <= row.past_last; c += lanes) {
    const auto cos_lat = hn::Set(f64, row.cos_lat);
    const auto dx = hn::Sub(hn::Mul(cos_lat, hn::LoadU(f64, row.cos_lon + c)), hn::Set(f64, k.x)),
               dy = hn::Sub(hn::Mul(cos_lat, hn::LoadU(f64, row.sin_lon + c)), hn::Set(f64, k.y));
    const auto chord2 = hn::Add(hn::Add(hn::Mul(dx, dx), hn::Mul(dy, dy)), hn::Set(f64, k.along_axis2));
    const auto reach2 = hn::Set(f64, k.reach2);
    if (hn::AllFalse(f64, hn::Lt(chord2, reach2))) continue;
    const auto steps = hn::Set(f64, k.steps);
    const auto distance = hn::Mul(hn::Sqrt(hn::Min(chord2, reach2)), steps);
    // Returns the wave of the outline, as CraterOutline::wave does.
    const auto wave = [&]() HWY_ATTR {
      const auto along = [&](auto offset) HWY_ATTR {
        return hn::Div(hn::DemoteTo(f32, hn::Mul(offset, steps)),
                       hn::Max(hn::DemoteTo(f32, distance), hn::Set(f32, kMinSteps)));
      };
      const auto east = along(hn::Add(hn::Mul(dx, hn::Set(f64, k.east_x)), hn::Mul(dy, hn::Set(f64, k.east_y))));
      const auto north =
          along(hn::Add(hn::Add(hn::Mul(dx, hn::Set(f64, k.north_x)), hn::Mul(dy, hn::Set(f64, k.north_y))),
                        hn::Set(f64, k.north_along_axis)));
      auto re = hn::Zero(f32), im = hn::Zero(f32);
      for (std::size_t n = CraterOutline::kWaves; n-- > 0;) {
        re = hn::Add(re, hn::Set(f32, k.outline->cosines()[n]));
        im = hn::Add(im, hn::Set(f32, k.outline->sines()[n]));
        const auto turned = hn::Sub(hn::Mul(re, east), hn::Mul(im, north));
        im = hn::Add(hn::Mul(re, north), hn::Mul(im, east));
        re = turned;
      }
      return hn::Sub(hn::Mul(re, east), hn::Mul(im, north));
    };
    const auto to_reach = hn::Sub(hn::Set(f64, k.reach_steps), distance);
    const auto fade = hn::Min(hn::DemoteTo(f32, hn::Mul(to_reach, hn::Set(f64, k.per_faded))), f32_one);
    const auto step = hn::Mul(distance, hn::PromoteTo(f64, hn::Sub(f32_one, hn::Mul(fade, wave()))));
    const auto i = hn::DemoteTo(i32, step);  // profile step at or before the position
    const auto f = hn::DemoteTo(f32, hn::Sub(step, hn::PromoteTo(f64, i)));
    const auto along = [&](const float* profile) HWY_ATTR {
      const auto low = hn::GatherIndex(f32, profile, i), high = hn::GatherIndex(f32, profile + 1, i);
      return hn::Add(low, hn::Mul(f, hn::Sub(high, low)));
    };
    const auto h = hn::Mul(hn::Set(f32, k.scale_m), hn::Add(hn::Mul(hn::Set(f32, 1 - k.share), along(k.younger)),
                                                            hn::Mul(hn::Set(f32, k.share), along(k.older))));
    const auto inside =
        hn::DemoteTo(f32, hn::Mul(hn::Sub(hn::Set(f64, k.reach_steps), step), hn::Set(f64, k.per_replaced)));
    const auto t = hn::Min(hn::Max(inside, hn::Zero(f32)), f32_one);
    const auto replaced = hn::Mul(hn::Mul(t, t), hn::Sub(hn::Set(f32, 3), hn::Mul(hn::Set(f32, 2), t)));
    const auto before = hn::LoadU(f32, heights_m + c);
    const auto after = hn::Add(hn::Mul(before, hn::Sub(f32_one, replaced)), h);
    // Keep the old height in lanes beyond the reach, whose lookup was clamped to the profile's end.
    const auto reached = hn::IfThenElseZero(hn::Lt(chord2, reach2), hn::Set(f64, 1));
    const auto is_reached = hn::Gt(hn::DemoteTo(f32, reached), hn::Zero(f32));
    hn::StoreU(hn::IfThenElse(is_reached, after, before), f32, heights_m + c);
  }
  for (; c < row.past_last; ++c) {
    const double x = row.cos_lat * row.cos_lon[c], y = row.cos_lat * row.sin_lon[c];
    const double chord2 = distance2(k, x, y);
    if (!(chord2 < k.reach2)) continue;
    const double step = round_step(k, x, y, std::sqrt(chord2) * k.steps);
    const auto i = static_cast<std::int32_t>(step);
    const auto f = static_cast<float>(step - i);
    const auto along = [&](const float* profile) { return profile[i] + f * (profile[i + 1] - profile[i]); };
    const float h = k.scale_m * ((1 - k.share) * along(k.younger) + k.share * along(k.older));
    const float replaced = CraterShape::replaced(static_cast<float>((k.reach_steps - step) * k.per_replaced));
    heights_m[c] = heights_m[c] * (1 - replaced) + h;
  }
}

void MarkCrater(const CraterOverRow& crater, const RowUnderCrater& row, float* HWY_RESTRICT marks) {
  constexpr double kRim = CraterShape::kStepsPerRadius;
  for (std::size_t c = row.first; c < row.past_last; ++c) {
    const double x = row.cos_lat * row.cos_lon[c], y = row.cos_lat * row.sin_lon[c];
    const double chord2 = distance2(crater, x, y);
    if (chord2 < crater.reach2 && round_step(crater, x, y, std::sqrt(chord2) * crater.steps) < kRim) marks[c] = 1;
  }
}

}  // namespace selenograph::dem::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::dem {

HWY_EXPORT(AddNoise);
HWY_EXPORT(CastCrater);
HWY_EXPORT(MarkCrater);

void add_noise(const NoiseRow& row, std::uint32_t seed, double amplitude, double* heights) {
  HWY_DYNAMIC_DISPATCH(AddNoise)(row, seed, amplitude, heights);
}

void cast_crater(const CraterOverRow& crater, const RowUnderCrater& row, float* heights_m) {
  HWY_DYNAMIC_DISPATCH(CastCrater)(crater, row, heights_m);
}

void mark_crater(const CraterOverRow& crater, const RowUnderCrater& row, float* marks) {
  HWY_DYNAMIC_DISPATCH(MarkCrater)(crater, row, marks);
}

}  // namespace selenograph::dem
#endif
