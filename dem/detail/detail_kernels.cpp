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

// One vector of a row's positions relative to a crater.
class AroundCrater {
  using F64 = hn::ScalableTag<double>;
  using F32 = hn::Rebind<float, F64>;
  using I32 = hn::Rebind<std::int32_t, F64>;
  using Floats = hn::Vec<F32>;

 public:
  AroundCrater(const CraterOverRow& crater, double cos_lat) : crater_(crater), cos_lat_(cos_lat) {}

  // Moves to the positions at these longitudes; returns false if the crater reaches none of them.
  HWY_INLINE bool move_to(const double* HWY_RESTRICT cos_lon, const double* HWY_RESTRICT sin_lon) {
    const F64 f64;
    const F32 f32;
    const CraterOverRow& k = crater_;
    const auto cos_lat = hn::Set(f64, cos_lat_);
    const auto dx = hn::Sub(hn::Mul(cos_lat, hn::LoadU(f64, cos_lon)), hn::Set(f64, k.x)),
               dy = hn::Sub(hn::Mul(cos_lat, hn::LoadU(f64, sin_lon)), hn::Set(f64, k.y));
    const auto chord2 = hn::Add(hn::Add(hn::Mul(dx, dx), hn::Mul(dy, dy)), hn::Set(f64, k.along_axis * k.along_axis));
    const auto reach2 = hn::Set(f64, k.reach2);
    const auto is_near = hn::Lt(chord2, reach2);
    if (hn::AllFalse(f64, is_near)) return false;
    // Clamp lanes beyond the reach, whose values are not used, to the table.
    const auto steps = hn::Set(f64, k.steps);
    const auto distance = hn::Mul(hn::Sqrt(hn::Min(chord2, reach2)), steps);
    reached_ = hn::DemoteTo(f32, hn::IfThenElseZero(is_near, hn::Set(f64, 1)));
    const auto to_east = hn::Add(hn::Mul(dx, hn::Set(f64, k.east_x)), hn::Mul(dy, hn::Set(f64, k.east_y)));
    const auto to_north = hn::Add(hn::Add(hn::Mul(dx, hn::Set(f64, k.north_x)), hn::Mul(dy, hn::Set(f64, k.north_y))),
                                  hn::Set(f64, k.north_z * k.along_axis));
    // Shortest distance in steps by which an offset is divided: the middle of a crater has no direction.
    constexpr float kMinSteps = 1e-6F;
    const auto per_step = hn::Div(hn::Set(f32, 1), hn::Max(hn::DemoteTo(f32, distance), hn::Set(f32, kMinSteps)));
    east_ = hn::Mul(hn::DemoteTo(f32, hn::Mul(to_east, steps)), per_step);
    north_ = hn::Mul(hn::DemoteTo(f32, hn::Mul(to_north, steps)), per_step);
    const auto to_reach = hn::Mul(hn::Sub(hn::Set(f64, k.reach_steps), distance), hn::Set(f64, k.per_faded));
    const auto fade = hn::Max(hn::Min(hn::DemoteTo(f32, to_reach), hn::Set(f32, 1)), hn::Zero(f32));
    const auto round = hn::Mul(distance, hn::PromoteTo(f64, hn::Sub(hn::Set(f32, 1), hn::Mul(fade, wave()))));
    step_ = hn::Min(hn::Max(round, hn::Zero(f64)), hn::Set(f64, k.last_step));
    return true;
  }

  // Returns the step of the table at which a round crater is as high as this one here (CraterOutline::round).
  HWY_INLINE hn::Vec<F64> step() const { return step_; }
  // Unit vector from the centre.
  HWY_INLINE Floats east() const { return east_; }
  HWY_INLINE Floats north() const { return north_; }
  // Returns `inside` in lanes within the reach, else `outside`.
  HWY_INLINE Floats where_reached(Floats inside, Floats outside) const {
    return hn::IfThenElse(hn::Gt(reached_, hn::Zero(F32())), inside, outside);
  }

  // A position between two entries of a table.
  struct TablePosition {
    hn::Vec<I32> entry;
    Floats fraction;  // share of the next entry
  };
  static HWY_INLINE TablePosition position_of(hn::Vec<F64> step) {
    const auto entry = hn::DemoteTo(I32(), step);
    return {entry, hn::DemoteTo(F32(), hn::Sub(step, hn::PromoteTo(F64(), entry)))};
  }
  static HWY_INLINE Floats look_up(const float* HWY_RESTRICT table, const TablePosition& at) {
    const auto low = hn::GatherIndex(F32(), table, at.entry), high = hn::GatherIndex(F32(), table + 1, at.entry);
    return hn::Add(low, hn::Mul(at.fraction, hn::Sub(high, low)));
  }

 private:
  // Returns CraterOutline::wave.
  HWY_INLINE Floats wave() const {
    const F32 f32;
    const CraterOutline& outline = *crater_.outline;
    auto re = hn::Zero(f32), im = hn::Zero(f32);
    for (std::size_t n = CraterOutline::kWaves; n-- > 0;) {
      re = hn::Add(re, hn::Set(f32, outline.cosines()[n]));
      im = hn::Add(im, hn::Set(f32, outline.sines()[n]));
      const auto turned = hn::Sub(hn::Mul(re, east_), hn::Mul(im, north_));
      im = hn::Add(hn::Mul(re, north_), hn::Mul(im, east_));
      re = turned;
    }
    return hn::Sub(hn::Mul(re, east_), hn::Mul(im, north_));
  }

  const CraterOverRow crater_;
  const double cos_lat_;
  hn::Vec<F64> step_;
  Floats east_, north_, reached_;
};

// Calls at(cos_lon, sin_lon, values, marks) for vectors of columns; the remaining columns are padded to a vector.
// `marks` may be null.
template <typename At>
HWY_INLINE void visit_vectors(const RowUnderCrater& row, float* values, float* marks, const At& at) {
  const std::size_t lanes = hn::Lanes(hn::ScalableTag<double>());
  std::size_t c = row.first;
  for (; c + lanes <= row.past_last; c += lanes)
    at(row.cos_lon + c, row.sin_lon + c, values + c, marks ? marks + c : nullptr);
  if (c >= row.past_last) return;
  constexpr std::size_t kMaxLanes = HWY_MAX_BYTES / sizeof(double);
  double cos_lon[kMaxLanes], sin_lon[kMaxLanes];
  float rest[kMaxLanes] = {}, rest_marks[kMaxLanes] = {};
  std::fill_n(cos_lon, kMaxLanes, row.cos_lon[c]);
  std::fill_n(sin_lon, kMaxLanes, row.sin_lon[c]);
  const std::size_t left = row.past_last - c;
  std::copy_n(row.cos_lon + c, left, cos_lon);
  std::copy_n(row.sin_lon + c, left, sin_lon);
  std::copy_n(values + c, left, rest);
  if (marks) std::copy_n(marks + c, left, rest_marks);
  at(cos_lon, sin_lon, rest, marks ? rest_marks : nullptr);
  std::copy_n(rest, left, values + c);
  if (marks) std::copy_n(rest_marks, left, marks + c);
}

// Implements cast_crater(). Vectorised by hand, because compilers do not vectorise the lookups in the profile.
void CastCrater(const CraterOverRow& crater, const RowUnderCrater& row, const CraterProfile& profile,
                float* HWY_RESTRICT heights_m, float* HWY_RESTRICT in_rim) {
  const hn::ScalableTag<double> f64;
  const hn::Rebind<float, decltype(f64)> f32;
  AroundCrater around(crater, row.cos_lat);
  visit_vectors(row, heights_m, in_rim,
                [&](const double* cos_lon, const double* sin_lon, float* heights, float* marks) HWY_ATTR {
                  if (!around.move_to(cos_lon, sin_lon)) return;
                  const auto step = around.step();
                  const auto h = AroundCrater::look_up(profile.heights_m, AroundCrater::position_of(step));
                  const auto inside =
                      hn::Mul(hn::Sub(hn::Set(f64, crater.reach_steps), step), hn::Set(f64, profile.per_replaced));
                  const auto t = hn::Min(hn::Max(hn::DemoteTo(f32, inside), hn::Zero(f32)), hn::Set(f32, 1));
                  const auto replaced = hn::Mul(hn::Mul(t, t), hn::Sub(hn::Set(f32, 3), hn::Mul(hn::Set(f32, 2), t)));
                  const auto before = hn::LoadU(f32, heights);
                  const auto after = hn::Add(hn::Mul(before, hn::Sub(hn::Set(f32, 1), replaced)), h);
                  hn::StoreU(around.where_reached(after, before), f32, heights);
                  const auto is_inside = hn::Lt(step, hn::Set(f64, profile.rim_steps));
                  if (!marks || hn::AllFalse(f64, is_inside)) return;
                  const auto ones = hn::DemoteTo(f32, hn::IfThenElseZero(is_inside, hn::Set(f64, 1)));
                  const auto marked = hn::LoadU(f32, marks);
                  hn::StoreU(around.where_reached(hn::Max(marked, ones), marked), f32, marks);
                });
}

// Implements brighten_around_crater().
void BrightenAroundCrater(const CraterOverRow& crater, const RowUnderCrater& row, const CraterGlow& glow,
                          float* HWY_RESTRICT added) {
  const hn::ScalableTag<double> f64;
  const hn::Rebind<float, decltype(f64)> f32;
  AroundCrater around(crater, row.cos_lat);
  // Returns the brightness of rays less 1 at a step.
  const auto rays = [&](auto step) HWY_ATTR {
    // Number azimuths along the square |x| + |y| = 1: p, 2 - p or 4 + p by the quadrant.
    const auto east = around.east(), north = around.north();
    const auto p = hn::Div(north, hn::Max(hn::Add(hn::Abs(east), hn::Abs(north)), hn::Set(f32, 1e-30F)));
    const auto in_east = hn::IfThenElse(hn::Lt(north, hn::Zero(f32)), hn::Add(hn::Set(f32, 4), p), p);
    const auto side = hn::IfThenElse(hn::Lt(east, hn::Zero(f32)), hn::Sub(hn::Set(f32, 2), p), in_east);
    constexpr double kPerSide = CraterGlow::kAzimuths / 4.0, kLast = CraterGlow::kAzimuths - 1e-3;
    const auto azimuth = AroundCrater::position_of(
        hn::Min(hn::Mul(hn::PromoteTo(f64, side), hn::Set(f64, kPerSide)), hn::Set(f64, kLast)));
    const auto outward = hn::Mul(hn::Sub(step, hn::Set(f32, glow.rim_steps)), hn::Set(f32, glow.far_per_step));
    const auto t = hn::Min(outward, hn::Set(f32, 1));
    const auto near_rays = AroundCrater::look_up(glow.near_rays, azimuth),
               far_rays = AroundCrater::look_up(glow.far_rays, azimuth);
    return hn::Sub(hn::Add(near_rays, hn::Mul(t, hn::Sub(far_rays, near_rays))), hn::Set(f32, 1));
  };
  visit_vectors(row, added, nullptr, [&](const double* cos_lon, const double* sin_lon, float* sums, float*) HWY_ATTR {
    if (!around.move_to(cos_lon, sin_lon)) return;
    const auto step = around.step();
    const auto at = AroundCrater::position_of(step);
    auto here = AroundCrater::look_up(glow.even, at);
    const auto rounded = hn::DemoteTo(f32, step);
    // Inside the rim nothing is in rays.
    if (glow.in_rays && !hn::AllFalse(f32, hn::Gt(rounded, hn::Set(f32, glow.rim_steps))))
      here = hn::Add(here, hn::Mul(AroundCrater::look_up(glow.in_rays, at), rays(rounded)));
    const auto before = hn::LoadU(f32, sums);
    hn::StoreU(around.where_reached(hn::Add(before, here), before), f32, sums);
  });
}

}  // namespace selenograph::dem::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::dem {

HWY_EXPORT(AddNoise);
HWY_EXPORT(CastCrater);
HWY_EXPORT(BrightenAroundCrater);

void add_noise(const NoiseRow& row, std::uint32_t seed, double amplitude, double* heights) {
  HWY_DYNAMIC_DISPATCH(AddNoise)(row, seed, amplitude, heights);
}

void cast_crater(const CraterOverRow& crater, const RowUnderCrater& row, const CraterProfile& profile, float* heights_m,
                 float* in_rim) {
  HWY_DYNAMIC_DISPATCH(CastCrater)(crater, row, profile, heights_m, in_rim);
}

void brighten_around_crater(const CraterOverRow& crater, const RowUnderCrater& row, const CraterGlow& glow,
                            float* added) {
  HWY_DYNAMIC_DISPATCH(BrightenAroundCrater)(crater, row, glow, added);
}

CraterOverRow crater_over_row(const Crater& crater, double reach_radii, double steps) {
  const double radius = crater.diameter_m / 2 / kMoonRadius_m, crater_reach = CraterShape::reach(crater.age);
  const EastNorthUp local = local_axes(crater.centre);
  return {.x = crater.centre.x(),
          .y = crater.centre.y(),
          .along_axis = 0,
          .reach2 = reach_radii * radius * reach_radii * radius,
          .steps = steps / radius,
          .last_step = reach_radii * steps,
          .reach_steps = crater_reach * steps,
          .per_faded = 1 / ((crater_reach - 1) * steps),
          .east_x = local.east.x(),
          .east_y = local.east.y(),
          .north_x = local.north.x(),
          .north_y = local.north.y(),
          .north_z = local.north.z(),
          .outline = &crater.outline};
}

}  // namespace selenograph::dem
#endif
