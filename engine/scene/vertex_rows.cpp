#include "engine/scene/vertex_rows.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/scene/vertex_rows.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Computes vertices relative to the anchor; see place_row().
void PlaceRow(const dem::Vertex* row, int n, const RowAngles& angles, const double* anchor, float* HWY_RESTRICT x,
              float* HWY_RESTRICT y, float* HWY_RESTRICT z) {
  const double cos_lat = angles.cos_lat, sin_lat = angles.sin_lat, ax = anchor[0], ay = anchor[1], az = anchor[2];
  const double *HWY_RESTRICT cos_lon = angles.cos_lon, *HWY_RESTRICT sin_lon = angles.sin_lon;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int c = 0; c < n; ++c) {
    const double radius = kMoonRadius_m + static_cast<double>(row[c].height_m), to_axis = radius * cos_lat;
    x[c] = static_cast<float>(to_axis * cos_lon[c] - ax);
    y[c] = static_cast<float>(to_axis * sin_lon[c] - ay);
    z[c] = static_cast<float>(radius * sin_lat - az);
  }
}

// Computes vertices in local axes; see local_row(). `axes`: east, north and up, three numbers each.
void RowAlong(const dem::Vertex* row, int n, const RowAngles& angles, const double* origin, const double* axes,
              LocalRow& out) {
  const double cos_lat = angles.cos_lat, sin_lat = angles.sin_lat;
  const double ox = origin[0], oy = origin[1], oz = origin[2];
  const double *HWY_RESTRICT cos_lon = angles.cos_lon, *HWY_RESTRICT sin_lon = angles.sin_lon;
  const double ex = axes[0], ey = axes[1], ez = axes[2], nx = axes[3], ny = axes[4], nz = axes[5];
  const double ux = axes[6], uy = axes[7], uz = axes[8];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int c = 0; c < n; ++c) {
    const double radius = kMoonRadius_m + static_cast<double>(row[c].height_m), to_axis = radius * cos_lat;
    const double x = to_axis * cos_lon[c] - ox, y = to_axis * sin_lon[c] - oy, z = radius * sin_lat - oz;
    out.east[c] = static_cast<float>(ex * x + ey * y + ez * z);
    out.north[c] = static_cast<float>(nx * x + ny * y + nz * z);
    out.up[c] = static_cast<float>(ux * x + uy * y + uz * z);
  }
}

const hn::ScalableTag<float> f;
using VF = hn::Vec<decltype(f)>;
using MF = hn::Mask<decltype(f)>;

struct Range {
  VF low, high;
  HWY_INLINE void extend(VF x, MF counts) {
    low = hn::IfThenElse(hn::And(counts, hn::Lt(x, low)), x, low);
    high = hn::IfThenElse(hn::And(counts, hn::Gt(x, high)), x, high);
  }
};

HWY_INLINE Range empty_range() {
  const VF infinite = hn::Set(f, std::numeric_limits<float>::infinity());
  return {infinite, hn::Neg(infinite)};
}

// Extends a box along east, north and up by the first n vertices of a row; comparisons with NaN leave it as it is.
void ExtendBox(const LocalRow& row, int n, float* low, float* high) {
  const int lanes = static_cast<int>(hn::Lanes(f));
  const float* along[3] = {row.east, row.north, row.up};
  for (int k = 0; k < 3; ++k) {
    Range range = empty_range();
    for (int c = 0; c < n; c += lanes)
      range.extend(hn::Load(f, along[k] + c), hn::FirstN(f, static_cast<std::size_t>(std::min(lanes, n - c))));
    low[k] = std::min(low[k], hn::GetLane(hn::MinOfLanes(f, range.low)));
    high[k] = std::max(high[k], hn::GetLane(hn::MaxOfLanes(f, range.high)));
  }
}

// Smallest horizontal cross product of two edges, relative to the product of their lengths (|e| + |n| each), for which
// float is relied on.
constexpr float kMinShareOfSides = 0.25F;

// Extends the steepest rises by the triangles between two rows. A triangle's rise follows from the cross product (e, n,
// u) of two of its edges, -e/u toward east and -n/u toward north. Both triangles of a quad have the same orientation:
//
//    c-----d     a: south-west corner, edges to b and c
//    | \   |     d: north-east corner, edges to c and b
//    |   \ |
//    a-----b
void ExtendSlopes(const LocalRow& south, const LocalRow& north, int quads, float* steepest) {
  const int lanes = static_cast<int>(hn::Lanes(f));
  const VF zero = hn::Zero(f), diagonal = hn::Set(f, std::sqrt(0.5F));
  Range rises[4] = {empty_range(), empty_range(), empty_range(), empty_range()};
  MF unsafe = hn::Ne(zero, zero);
  const auto triangle = [&](VF ae, VF an, VF au, VF be, VF bn, VF bu, MF in_row) HWY_ATTR {
    const VF normal_e = hn::Sub(hn::Mul(an, bu), hn::Mul(au, bn)), normal_n = hn::Sub(hn::Mul(au, be), hn::Mul(ae, bu)),
             normal_u = hn::Sub(hn::Mul(ae, bn), hn::Mul(an, be));
    // Do not rely on float for triangles much thinner than half a quad: one of them makes all rises infinite.
    const VF sides = hn::Mul(hn::Add(hn::Abs(ae), hn::Abs(an)), hn::Add(hn::Abs(be), hn::Abs(bn)));
    const MF safe = hn::Gt(normal_u, hn::Mul(sides, hn::Set(f, kMinShareOfSides)));
    const MF degenerate = hn::And(hn::Eq(normal_e, zero), hn::And(hn::Eq(normal_n, zero), hn::Eq(normal_u, zero)));
    const MF has_data =
        hn::Eq(hn::Add(hn::Add(normal_e, normal_n), normal_u), hn::Add(hn::Add(normal_e, normal_n), normal_u));
    unsafe = hn::Or(unsafe, hn::And(hn::And(in_row, has_data), hn::Not(hn::Or(safe, degenerate))));
    in_row = hn::And(in_row, safe);
    const VF to_east = hn::Neg(hn::Div(normal_e, normal_u)), to_north = hn::Neg(hn::Div(normal_n, normal_u));
    rises[0].extend(to_east, in_row);
    rises[2].extend(to_north, in_row);
    rises[1].extend(hn::Mul(hn::Add(to_east, to_north), diagonal), in_row);
    rises[3].extend(hn::Mul(hn::Sub(to_north, to_east), diagonal), in_row);
  };
  for (int c = 0; c < quads; c += lanes) {
    const MF in_row = hn::FirstN(f, static_cast<std::size_t>(std::min(lanes, quads - c)));
    const auto corner = [&](const LocalRow& row, int column_shift, VF& east, VF& northward, VF& up) HWY_ATTR {
      east = hn::LoadU(f, row.east + c + column_shift);
      northward = hn::LoadU(f, row.north + c + column_shift);
      up = hn::LoadU(f, row.up + c + column_shift);
    };
    VF ae, an, au, be, bn, bu, ce, cn, cu, de, dn, du;
    corner(south, 0, ae, an, au);
    corner(south, 1, be, bn, bu);
    corner(north, 0, ce, cn, cu);
    corner(north, 1, de, dn, du);
    triangle(hn::Sub(be, ae), hn::Sub(bn, an), hn::Sub(bu, au), hn::Sub(ce, ae), hn::Sub(cn, an), hn::Sub(cu, au),
             in_row);
    triangle(hn::Sub(ce, de), hn::Sub(cn, dn), hn::Sub(cu, du), hn::Sub(be, de), hn::Sub(bn, dn), hn::Sub(bu, du),
             in_row);
  }
  const bool any_unsafe = !hn::AllFalse(f, unsafe);
  for (int direction = 0; direction < 4; ++direction) {
    const float highest = any_unsafe ? std::numeric_limits<float>::infinity()
                                     : hn::GetLane(hn::MaxOfLanes(f, rises[direction].high)),
                lowest = any_unsafe ? -std::numeric_limits<float>::infinity()
                                    : hn::GetLane(hn::MinOfLanes(f, rises[direction].low));
    steepest[direction] = std::max(steepest[direction], highest);
    steepest[direction + 4] = std::max(steepest[direction + 4], -lowest);
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(PlaceRow);
HWY_EXPORT(RowAlong);
HWY_EXPORT(ExtendBox);
HWY_EXPORT(ExtendSlopes);

void place_row(const dem::Vertex* row, int n, const RowAngles& angles, const Vec3& anchor_m, float* x, float* y,
               float* z) {
  HWY_DYNAMIC_DISPATCH(PlaceRow)(row, n, angles, anchor_m.data(), x, y, z);
}

void local_row(const dem::Vertex* row, int n, const RowAngles& angles, const Vec3& origin_m, const EastNorthUp& axes,
               LocalRow& out) {
  const double along[9] = {axes.east.x(),  axes.east.y(), axes.east.z(), axes.north.x(), axes.north.y(),
                           axes.north.z(), axes.up.x(),   axes.up.y(),   axes.up.z()};
  HWY_DYNAMIC_DISPATCH(RowAlong)(row, n, angles, origin_m.data(), along, out);
}

LocalBounds::LocalBounds() {
  constexpr float kInfinite = std::numeric_limits<float>::infinity();
  std::fill_n(low, 3, kInfinite);
  std::fill_n(high, 3, -kInfinite);
  std::fill_n(steepest, 8, -kInfinite);
}

void LocalBounds::extend(const LocalRow& row, int n) { HWY_DYNAMIC_DISPATCH(ExtendBox)(row, n, low, high); }

void LocalBounds::extend(const LocalRow& south, const LocalRow& north, int quads) {
  HWY_DYNAMIC_DISPATCH(ExtendSlopes)(south, north, quads, steepest);
}

}  // namespace selenograph::engine
#endif
