#include "engine/indirect/segment_light.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/indirect/segment_light.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "engine/relief/cell_readers.h"

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Sets a segment's integrals over elevations from tangent a to b > a: cos^2 e gives (angle + b / (1 + b^2) - a / (1 +
// a^2)) / 2, and sin e cos e gives (b^2 / (1 + b^2) - a^2 / (1 + a^2)) / 2.
void IntegrateElevation(const float* from, const float* to, VisibleSegment& segment) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const bool visible = (to[i] > from[i]) & (from[i] > kNoHorizon);
    const float a = visible ? from[i] : 0, b = visible ? to[i] : 0;
    // The squares of the cosines, 1 / (1 + a^2) and 1 / (1 + b^2), take one division.
    const float square_a = 1 + a * a, square_b = 1 + b * b, inverse = 1 / (square_a * square_b);
    const float cos2_a = inverse * square_b, cos2_b = inverse * square_a;
    // The angle is atan(b) - atan(a) = atan(x), x = (b - a) / (1 + a b), taken as x / (1 + 0.28 x^2): the error is at
    // most 5e-3, where a cliff fills the view.
    const float numerator = b - a, denominator = 1 + a * b;
    const float angle = numerator * denominator / (denominator * denominator + 0.28F * numerator * numerator);
    const float along = 0.5F * (angle + b * cos2_b - a * cos2_a), up = 0.5F * (b * b * cos2_b - a * a * cos2_a);
    segment.along[i] = visible ? along : 0;
    segment.up[i] = visible ? up : 0;
    segment.tangent[i] = 0.5F * (a + b);
  }
}

// Adds the sky above a horizon of tangent t. Over elevations from atan t to pi / 2, cos^2 integrates to (pi / 2 - atan
// t - t / (1 + t^2)) / 2, and sin cos to 1 / (1 + t^2) / 2. A horizon below a tangent of -2 counts as -2; a lane
// without ground has the level horizon, 0.
void AddSky(const AzimuthLanes& lanes, const float* horizon, float (*sum)[kPacket]) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    constexpr float kHalfPi = 1.5707963F;
    const float h = horizon[i], t = h > -2 ? h : (h > kNoHorizon ? -2.F : 0.F), size = t < 0 ? -t : t;
    // atan x is taken as x / (1 + 0.28 x^2) up to 1, and beyond as pi / 2 - atan(1 / x).
    const float below_one = size < 1 ? size : 1 / size,
                atan_below_one = below_one / (1 + 0.28F * below_one * below_one);
    const float atan_size = size < 1 ? atan_below_one : kHalfPi - atan_below_one, cos2 = 1 / (1 + t * t);
    const float along = 0.5F * (kHalfPi - (t < 0 ? -atan_size : atan_size) - t * cos2), up = 0.5F * cos2;
    for (int k = 0; k < 3; ++k) sum[k][i] += along * lanes.along[k][i] + up * lanes.up[k][i];
  }
}

// Normals (x and y in the grids' axes) and albedo of a segment's ground.
struct alignas(64) GroundLanes {
  float nx[kPacket], ny[kPacket], albedo[kPacket];
};

// Returns the cells of a segment.
HWY_INLINE RowOfCells CellsOfSegment(const GroundSegment& segment, const GroundView& view, const ReliefGrid& grid) {
  return {segment.row, segment.column, static_cast<float>(view.stride) / grid.coarser, 0};
}

// Adds a segment's rises to the horizons, and reads the light on its cells. Returns false if all that is visible is
// dark.
bool ReadLight(const GroundSegment& segment, const RowOfCells& cells, const LitGrid& ground, int glow_number,
               const float* from, float* to, SegmentLight& out) {
  const GroundLight& light = ground.light;
  const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(segment.row) * ground.grid->side;
  const Sixteen d;
  const hn::Rebind<std::uint8_t, Sixteen> d8;
  const hn::Rebind<std::uint32_t, Sixteen> d32;
  auto brightest = hn::Zero(d);
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto code = hn::PromoteTo(d32, hn::LoadU(d8, segment.rise + i));
    const auto visible = hn::RebindMask(d, hn::Ne(code, hn::Zero(d32)));
    const auto rise = hn::BitCast(d, hn::Add(hn::ShiftLeft<kRiseShift>(code), hn::Set(d32, kRiseZero)));
    hn::Store(hn::Add(hn::Load(d, from + i), hn::IfThenElseZero(visible, rise)), d, to + i);
    const RowColumns<Sixteen> columns(d, cells, i);
    const auto lit = hn::IfThenElseZero(visible, columns.west(d, light.lit.data() + row));
    hn::Store(lit, d, out.lit + i);
    auto glow = hn::Zero(d);
    if (glow_number >= 0)
      glow =
          hn::IfThenElseZero(visible, columns.west(d, light.glow[static_cast<std::size_t>(glow_number)].data() + row));
    hn::Store(glow, d, out.glow + i);
    brightest = hn::Max(brightest, hn::Max(lit, glow));
  }
  return !hn::AllFalse(d, hn::Gt(brightest, hn::Zero(d)));
}

// Sets the cosines of incidence, emission and phase on a segment's ground, and its albedo.
void SetAngles(const VisibleSegment& segment, const RowOfCells& cells, const LitGrid& ground, const AzimuthLanes& lanes,
               SegmentLight& out) {
  const GroundLight& light = ground.light;
  const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(cells.row) * ground.grid->side;
  GroundLanes values;
  const Sixteen d;
  for (int i = 0; i < kPacket; i += kLanes) {
    const RowColumns<Sixteen> columns(d, cells, i);
    hn::Store(columns.west(d, light.nx.data() + row), d, values.nx + i);
    hn::Store(columns.west(d, light.ny.data() + row), d, values.ny + i);
    const auto albedo = light.albedo.empty() ? hn::Set(d, 1.F) : columns.west(d, light.albedo.data() + row);
    hn::Store(albedo, d, values.albedo + i);
  }
  const float sx = lanes.sun[0], sy = lanes.sun[1], sz = lanes.sun[2];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float nx = values.nx[i], ny = values.ny[i], square = 1 - nx * nx - ny * ny,
                nz = std::sqrt(square > 0 ? square : 0);
    const float cos_elevation = 1 / std::sqrt(1 + segment.tangent[i] * segment.tangent[i]),
                sin_elevation = segment.tangent[i] * cos_elevation;
    // Direction from the point to the ground. The light goes the other way: mu and the cosine of phase have its sign
    // reversed.
    const float x = cos_elevation * lanes.along[0][i] + sin_elevation * lanes.up[0][i],
                y = cos_elevation * lanes.along[1][i] + sin_elevation * lanes.up[1][i],
                z = cos_elevation * lanes.along[2][i] + sin_elevation * lanes.up[2][i];
    // The Brdf is undefined at mu0 = 0: 1e-9 stands for ground that does not face the Sun.
    const float mu0 = nx * sx + ny * sy + nz * sz, mu = -(x * nx + y * ny + z * nz);
    out.mu0[i] = static_cast<double>(mu0 > 1e-9F ? mu0 : 1e-9F);
    out.mu[i] = static_cast<double>(mu > 0 ? mu : 0);
    out.cos_phase[i] = static_cast<double>(-(x * sx + y * sy + z * sz));
    out.albedo[i] = static_cast<double>(values.albedo[i]);
  }
}

// Implements next_lit_segment().
bool NextLitSegment(const GroundView& view, std::span<const LitGrid> ground, const AzimuthLanes& lanes, int glow,
                    SegmentCursor& cursor, VisibleSegment& segment, SegmentLight& light) {
  alignas(64) float to[kPacket];
  while (cursor.segment < cursor.past_last) {
    const GroundSegment& visible = view.segments[cursor.segment++];
    const LitGrid& lit_grid = ground[visible.grid];
    const RowOfCells cells = CellsOfSegment(visible, view, *lit_grid.grid);
    const bool lit = ReadLight(visible, cells, lit_grid, glow, cursor.horizon, to, light);
    if (lit) {
      IntegrateElevation(cursor.horizon, to, segment);
      SetAngles(segment, cells, lit_grid, lanes, light);
    }
    std::copy_n(to, kPacket, cursor.horizon);
    if (lit) return true;
  }
  return false;
}

// Implements add_segment().
void AddSegment(const VisibleSegment& segment, const AzimuthLanes& lanes, const SegmentLight& light,
                const double* reflected, bool times_albedo, float (*sum)[kPacket]) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double factor = times_albedo ? light.albedo[i] : 1;
    const float direct = light.lit[i] > 0 ? light.lit[i] * static_cast<float>(reflected[i] * factor) : 0,
                radiance = direct + light.glow[i];
    const float along = radiance * segment.along[i], up = radiance * segment.up[i];
    sum[0][i] += along * lanes.along[0][i] + up * lanes.up[0][i];
    sum[1][i] += along * lanes.along[1][i] + up * lanes.up[1][i];
    sum[2][i] += along * lanes.along[2][i] + up * lanes.up[2][i];
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(NextLitSegment);
HWY_EXPORT(AddSegment);
HWY_EXPORT(AddSky);

SegmentCursor::SegmentCursor(const GroundView& view, std::size_t azimuth)
    : segment(azimuth == 0 ? 0 : view.azimuths[azimuth - 1].past_last), past_last(view.azimuths[azimuth].past_last) {
  std::copy_n(view.azimuths[azimuth].first_tangent, kPacket, horizon);
}

bool next_lit_segment(const GroundView& view, std::span<const LitGrid> ground, const AzimuthLanes& lanes, int glow,
                      SegmentCursor& cursor, VisibleSegment& segment, SegmentLight& light) {
  return HWY_DYNAMIC_DISPATCH(NextLitSegment)(view, ground, lanes, glow, cursor, segment, light);
}

void add_segment(const VisibleSegment& segment, const AzimuthLanes& lanes, const SegmentLight& light,
                 const double* reflected, bool times_albedo, float (*sum)[kPacket]) {
  HWY_DYNAMIC_DISPATCH(AddSegment)(segment, lanes, light, reflected, times_albedo, sum);
}

void add_sky(const AzimuthLanes& lanes, const float* horizon, float (*sum)[kPacket]) {
  HWY_DYNAMIC_DISPATCH(AddSky)(lanes, horizon, sum);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
