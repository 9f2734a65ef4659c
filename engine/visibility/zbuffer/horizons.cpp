#include "engine/visibility/zbuffer/horizons.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "dem/base/pool.h"
#include "dem/base/vector_targets.h"
#include "engine/scene/vertex_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/zbuffer/horizons.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "engine/visibility/zbuffer/to_front.h"

#ifndef SELENOGRAPH_ENGINE_HORIZONS_SHARED
#define SELENOGRAPH_ENGINE_HORIZONS_SHARED
namespace selenograph::engine {

// A row of vertices of a block in light space, relative to the origin of the block. Entries before the first and after
// the last vertex are NaN.
struct HorizonRow {
  static constexpr int kBefore = 16, kCapacity = 112;
  alignas(64) float u[kCapacity];
  alignas(64) float v[kCapacity];
  alignas(64) float d[kCapacity];
};

// Distances of a sample from an edge, as a share of the edge length. Nearer than kNearest, the sample does not see the
// edge. Float resolves the ends of an edge to kEndError of its length, which is much of the disc as seen from nearby:
// nearer than kNear, the edge therefore counts as lower by that error. Otherwise edges of the facet that the sample
// lies on would darken scattered samples of level ground.
constexpr float kNearest = 1.0F / 1024, kNear = 1.0F / 16, kEndError = 4e-6F;
constexpr std::size_t kMaxEdges = 3 * 96;  // of a row of quads: three per quad

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using F = hn::CappedTag<float, 16>;
using VF = hn::Vec<F>;
using MF = hn::Mask<F>;
constexpr F float_tag;

HWY_INLINE VF broadcast(float x) { return hn::Set(float_tag, x); }

// A vector of points or of differences in light space, m.
struct Point {
  VF u, v, d;
};
HWY_INLINE Point operator-(const Point& a, const Point& b) {
  return {hn::Sub(a.u, b.u), hn::Sub(a.v, b.v), hn::Sub(a.d, b.d)};
}
// Returns a b - c e.
HWY_INLINE VF product_difference(VF a, VF b, VF c, VF e) { return hn::Sub(hn::Mul(a, b), hn::Mul(c, e)); }
HWY_INLINE Point cross(const Point& a, const Point& b) {
  return {product_difference(a.v, b.d, a.d, b.v), product_difference(a.d, b.u, a.u, b.d),
          product_difference(a.u, b.v, a.v, b.u)};
}
HWY_INLINE VF dot(const Point& a, const Point& b) {
  return hn::Add(hn::Mul(a.u, b.u), hn::Add(hn::Mul(a.v, b.v), hn::Mul(a.d, b.d)));
}

// Orientation of triangles: `toward` at least one point of the disc, `away` from at least one; both if the disc's edge
// crosses their plane. A degenerate triangle is not `valid`.
struct Facing {
  MF toward, away, valid;
};
// Returns the orientation from a normal n of any length. The disc's middle is in the direction (aim, 0, 1) and its edge
// a radius from there, so n . direction is between middle - radius |(n.u, n.v)| and middle + radius |(n.u, n.v)|. The
// numbers are compared by their squares, which keep the sign.
HWY_INLINE Facing facing_of(const Point& n, const DiscReach& reach) {
  const VF middle = hn::Add(hn::Mul(broadcast(reach.aim), n.u), n.d);
  const VF across2 = hn::Add(hn::Mul(n.u, n.u), hn::Mul(n.v, n.v));
  const VF limit = hn::Mul(broadcast(reach.radius * reach.radius), across2);
  const VF signed2 = hn::Mul(middle, hn::Abs(middle));
  const VF size = hn::Add(across2, hn::Mul(n.d, n.d));
  return {hn::Gt(signed2, hn::Neg(limit)), hn::Lt(signed2, limit), hn::Gt(size, hn::Zero(float_tag))};
}

// Writes to `out` the edges of the quads between `here` and `north` that may be a horizon: diagonals, western and
// southern edges that overlap v_low to v_high. `south` has the triangles on the other side of the southern edges. An
// edge without a valid neighbour (at the border of the block, next to voids and collapsed triangles) counts as if its
// neighbour faced both ways. Returns the number of edges.
//
//    w ---- nw ---- ne     row `north`
//      \    |  \    |      Each edge is tested for the triangle a, b, nw of the quad and its neighbour: the one with ne
//        \  |    \  |      across the diagonal, with w across the western edge, with s across the southern edge.
//           a ----- b      row `here`
//             \     |
//                \  s      row `south`
std::size_t FindEdges(const HorizonRow& south, const HorizonRow& here, const HorizonRow& north, int quads,
                      const DiscReach& reach, float v_low, float v_high, Horizons::Edge* out) {
  const int lanes = static_cast<int>(hn::Lanes(float_tag));
  std::size_t n = 0;
  const auto load = [](const HorizonRow& row, int c) HWY_ATTR {
    const int at = HorizonRow::kBefore + c;
    return Point{hn::LoadU(float_tag, row.u + at), hn::LoadU(float_tag, row.v + at), hn::LoadU(float_tag, row.d + at)};
  };
  const VF low = broadcast(v_low), high = broadcast(v_high), zero = hn::Zero(float_tag);
  for (int c = 0; c <= quads; c += lanes) {
    const Point a = load(here, c);
    const Point b = load(here, c + 1);
    const Point nw = load(north, c);
    const Point ne = load(north, c + 1);
    const auto in_rows = [&](const Point& p, const Point& q) HWY_ATTR {
      return hn::And(hn::Le(hn::Min(p.v, q.v), high), hn::Ge(hn::Max(p.v, q.v), low));
    };
    const MF in_diagonal = in_rows(b, nw), in_west = in_rows(a, nw), in_south = in_rows(a, b);
    if (hn::AllFalse(float_tag, hn::Or(in_diagonal, hn::Or(in_west, in_south)))) continue;
    const Point w = load(north, c - 1), s = load(south, c + 1);
    const Point ab = b - a, ac = nw - a, bc = nw - b, bd = ne - b, aw = w - a, as = s - a;
    const Point lower = cross(ab, ac);
    const Facing own = facing_of(lower, reach);
    const Facing upper = facing_of(cross(bd, bc), reach);
    const Facing west = facing_of(cross(ac, aw), reach);
    const Facing below = facing_of(cross(as, ab), reach);
    // An edge is convex if the opposite vertex of the neighbouring triangle lies below the plane of the first. A convex
    // edge between a triangle turned toward part of the disc and one turned away from part of it may be a horizon.
    const auto edges = [&](const Facing& neighbour, const Point& to_opposite, MF in) HWY_ATTR {
      const MF both = hn::And(own.valid, neighbour.valid);
      const MF differ = hn::Or(hn::And(own.toward, neighbour.away), hn::And(own.away, neighbour.toward));
      const MF convex = hn::Lt(dot(lower, to_opposite), zero);
      const MF alone = hn::Or(hn::And(hn::Not(neighbour.valid), hn::And(own.valid, own.away)),
                              hn::And(hn::Not(own.valid), hn::And(neighbour.valid, neighbour.away)));
      return hn::And(in, hn::Or(hn::And(both, hn::And(differ, convex)), alone));
    };
    const auto append_edges = [&](MF selected, const Point& p, const Point& q) HWY_ATTR {
      if (hn::AllFalse(float_tag, selected)) return;
      alignas(64) float ends[6][16] = {};
      const VF from[6] = {p.u, p.v, p.d, q.u, q.v, q.d};
      const std::size_t found = hn::CountTrue(float_tag, selected);
      const ToFront to_front(selected);
      for (int k = 0; k < 6; ++k) hn::Store(to_front(from[k]), float_tag, ends[k]);
      for (std::size_t i = 0; i < found; ++i, ++n)
        for (int k = 0; k < 3; ++k) {
          out[n].from[k] = ends[k][i];
          out[n].to[k] = ends[3 + k][i];
        }
    };
    append_edges(edges(upper, bd, in_diagonal), b, nw);
    append_edges(edges(west, aw, in_west), a, nw);
    append_edges(edges(below, as, in_south), a, b);
  }
  return n;
}

// Raises the horizons of sixteen samples by one edge with the ends p and q, in light space relative to the origin of
// the group. 1 and 2 in names are the ends p and q, relative to a sample.
HWY_INLINE void raise_horizons(const float* p, const float* q, const DiscReach& reach, HorizonGroup& group) {
  const int lanes = static_cast<int>(hn::Lanes(float_tag));
  const VF zero = hn::Zero(float_tag);
  const float du = q[0] - p[0];
  const float dv = q[1] - p[1];
  const float dd = q[2] - p[2];
  const float length = std::sqrt(du * du + (dv * dv + dd * dd));
  const float nearest = kNearest * length;
  const float near = kNear * length;
  for (int i = 0; i < HorizonGroup::kSize; i += lanes) {
    const VF u = hn::Load(float_tag, group.u + i);
    const VF v = hn::Load(float_tag, group.v + i);
    const VF d = hn::Load(float_tag, group.d + i);
    const VF d1 = hn::Sub(broadcast(p[2]), d);
    const VF d2 = hn::Sub(broadcast(q[2]), d);
    const VF u1 = hn::Sub(broadcast(p[0]), u);
    const VF u2 = hn::Sub(broadcast(q[0]), u);
    const VF v1 = hn::Sub(broadcast(p[1]), v);
    const VF v2 = hn::Sub(broadcast(q[1]), v);
    const VF height = hn::Max(d1, d2);
    const VF aside = hn::Mul(broadcast(reach.aside), height);
    const VF below = hn::Mul(broadcast(reach.below), height);
    const VF above = hn::Mul(broadcast(-reach.above), height);
    MF may_see = hn::Gt(height, broadcast(nearest));
    may_see = hn::And(may_see, hn::And(hn::Le(hn::Min(v1, v2), aside), hn::Ge(hn::Max(v1, v2), hn::Neg(aside))));
    may_see = hn::And(may_see, hn::And(hn::Le(hn::Min(u1, u2), below), hn::Ge(hn::Max(u1, u2), above)));
    if (hn::AllFalse(float_tag, may_see)) continue;
    group.raised = true;
    for (int j = 0; j < DiscLight::kColumns; ++j) {
      // Find where the edge crosses the column, the line v = x d; g1 and g2 are the ends' distances from it in v. This
      // is watertight: two edges with a common end compute the same sign for it.
      const VF x = broadcast(reach.columns[j]), g1 = hn::Sub(v1, hn::Mul(x, d1)), g2 = hn::Sub(v2, hn::Mul(x, d2));
      const MF crosses = hn::And(may_see, hn::Xor(hn::Lt(g1, zero), hn::Lt(g2, zero)));
      if (hn::AllFalse(float_tag, crosses)) continue;
      const VF along = product_difference(u2, g1, u1, g2), toward = product_difference(d1, g2, d2, g1);
      // By linear interpolation to g = 0, the crossing has d = toward / span and u = -along / span, so its slope -u / d
      // is along / toward.
      const VF span = hn::Sub(g2, g1);
      const MF same = hn::Not(hn::Xor(hn::Lt(toward, zero), hn::Lt(span, zero)));
      const MF before =
          hn::And(crosses, hn::And(same, hn::Gt(hn::Abs(toward), hn::Mul(broadcast(nearest), hn::Abs(span)))));
      float* horizon = group.horizon[j] + i;
      const VF old_slope = hn::Load(float_tag, horizon);
      VF slope = hn::Div(along, toward);
      const MF is_near = hn::And(before, hn::Lt(hn::Abs(toward), hn::Mul(broadcast(near), hn::Abs(span))));
      if (!hn::AllFalse(float_tag, is_near)) {
        // Excess of 1 / distance over that at kNear.
        const VF nearer = hn::Sub(hn::Div(span, toward), broadcast(1 / near));
        slope = hn::Sub(slope, hn::Mul(broadcast(kEndError * length), hn::Max(nearer, zero)));
      }
      hn::Store(hn::IfThenElse(hn::And(before, hn::Gt(slope, old_slope)), slope, old_slope), float_tag, horizon);
    }
  }
}

// Raises the horizons of the groups in n slots by an edge. `origin`: of the edge's coordinates, in light space.
void RaiseHorizons(const Horizons::Edge& edge, const double* origin, const DiscReach& reach, const std::int32_t* slots,
                   std::size_t n, HorizonGroup* groups) {
  for (std::size_t i = 0; i < n; ++i) {
    HorizonGroup& group = groups[slots[i]];
    float p[3], q[3];
    for (int k = 0; k < 3; ++k) {
      const auto shift = static_cast<float>(origin[k] - group.origin[k]);
      p[k] = edge.from[k] + shift;
      q[k] = edge.to[k] + shift;
    }
    raise_horizons(p, q, reach, group);
  }
}

// Sets `out`, per column and sample, to the horizons in radii above the middle of the disc. From the middle column
// outward it then mends the columns whose horizon has left the examined range.
void RelativeToDisc(const HorizonGroup& group, const DiscReach& reach, float (*out)[HorizonGroup::kSize]) {
  const float per_radius = 1 / reach.radius;
  const float top = (reach.aim + reach.above) * per_radius;
  for (int j = 0; j < DiscLight::kColumns; ++j) {
    SELENOGRAPH_INDEPENDENT_LANES
    for (int i = 0; i < HorizonGroup::kSize; ++i) out[j][i] = (group.horizon[j][i] + reach.aim) * per_radius;
  }
  constexpr int kMiddle = DiscLight::kColumns / 2;
  const auto follow = [&](int from, int to) HWY_ATTR {
    const float rise = Horizons::kSteepest * std::abs(reach.columns[to] - reach.columns[from]) * per_radius;
    SELENOGRAPH_INDEPENDENT_LANES
    for (int i = 0; i < HorizonGroup::kSize; ++i) {
      const float neighbour = out[from][i] < top ? out[from][i] : top;
      const float lowest = neighbour - rise;
      const float here = out[to][i];
      // A horizon far below its neighbour, which is at the top of the range, has only left the examined range: treat it
      // as above.
      const bool above = (neighbour >= top - rise) & (here < lowest);
      out[to][i] = above ? neighbour : here;
    }
  };
  for (int j = kMiddle; j + 1 < DiscLight::kColumns; ++j) follow(j, j + 1);
  for (int j = kMiddle; j > 0; --j) follow(j, j - 1);
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(FindEdges);
HWY_EXPORT(RaiseHorizons);
HWY_EXPORT(RelativeToDisc);

void Horizons::begin(const DiscLight& disc, double aim, const Axes& axes, const LightBand& band, std::size_t count,
                     ResidualOf residual_of) {
  axes_ = axes;
  band_ = &band;
  count_ = count;
  residual_of_ = std::move(residual_of);
  const double radius = disc.radius();
  reach_.aside = 0;
  for (int j = 0; j < DiscLight::kColumns; ++j) {
    reach_.columns[j] = static_cast<float>(radius) * disc.column(j);
    reach_.aside = std::max(reach_.aside, std::abs(reach_.columns[j]));
  }
  reach_.below = static_cast<float>(radius * (aim + 1));
  reach_.aim = static_cast<float>(radius * aim);
  reach_.above = static_cast<float>(radius * kAbove);
  reach_.radius = static_cast<float>(radius);
  lowest_ = *std::min_element(band.min_d.begin(), band.min_d.end());
  slots_.assign((count_ + HorizonGroup::kSize - 1) / HorizonGroup::kSize, -1);
  used_ = 0;
}

// Sets `out` to the window of samples before whose disc the box `b` may stand; false if there is none. The lower a
// sample, the farther from the box its disc may be hidden. So the cells are bounded twice: first with `lowest`, a lower
// bound of d of all samples, then with the lowest sample of the cells found.
bool Horizons::find_window(const LightBox& b, float lowest, Window& out) const {
  const LightBand& band = *band_;
  const auto column = [&](float u) {
    return static_cast<int>(
        std::clamp(std::floor((u - band.u0) * band.per_u), 0.F, static_cast<float>(band.columns - 1)));
  };
  const auto row = [&](float v) {
    return static_cast<int>(std::clamp(std::floor((v - band.v0) * band.per_v), 0.F, static_cast<float>(band.rows - 1)));
  };
  out.lowest = lowest;
  for (int k = 0; k < 2; ++k) {
    const float height = b.d_high - out.lowest;
    if (!(height > 0)) return false;
    const float aside = reach_.aside * height + band.margin_m;
    const float below = reach_.below * height + band.margin_m;
    const float above = reach_.above * height + band.margin_m;
    if (b.v_high + aside < band.v0 || b.v_low - aside > band.v_end()) return false;
    if (b.u_high + above < band.u0 || b.u_low - below > band.u_end()) return false;
    out.c0 = column(b.u_low - below);
    out.c1 = column(b.u_high + above);
    out.r0 = row(b.v_low - aside);
    out.r1 = row(b.v_high + aside);
    out.lowest = std::numeric_limits<float>::infinity();
    for (int r = out.r0; r <= out.r1; ++r)
      for (int q = out.c0 / LightBand::kCoarse; q <= out.c1 / LightBand::kCoarse; ++q)
        out.lowest = std::min(out.lowest, band_->coarse_min_d(r, q));
  }
  return out.lowest < b.d_high;
}

// Returns the slot of a group of samples. On first use, fills it with the samples and no horizon.
std::int32_t Horizons::slot_of(std::size_t group) {
  if (slots_[group] >= 0) return slots_[group];
  slots_[group] = static_cast<std::int32_t>(used_);
  if (used_ == groups_.size()) groups_.resize(std::max<std::size_t>(64, 2 * used_));
  HorizonGroup& new_group = groups_[used_++];
  const std::size_t first = group * HorizonGroup::kSize;
  const std::size_t past_last = std::min(count_, first + HorizonGroup::kSize);
  constexpr float kInfinite = std::numeric_limits<float>::infinity();
  // Take one of the samples as the origin: differences between coordinates of neighbours are exact.
  float origin[3] = {band_->u[first], band_->v[first], 0};
  for (std::size_t i = first; i < past_last; ++i)
    if (band_->d[i] < kInfinite) origin[2] = band_->d[i];
  for (int k = 0; k < 3; ++k) new_group.origin[k] = static_cast<double>(origin[k]);
  for (std::size_t i = 0; i < HorizonGroup::kSize; ++i) {
    const std::size_t sample = first + i;
    const bool is_lit = sample < past_last && band_->d[sample] < kInfinite;
    const LightResidual residual = is_lit ? residual_of_(sample) : LightResidual{};
    new_group.u[i] = is_lit ? (band_->u[sample] - origin[0]) + residual.u : 0;
    new_group.v[i] = is_lit ? (band_->v[sample] - origin[1]) + residual.v : 0;
    new_group.d[i] = is_lit ? (band_->d[sample] - origin[2]) + residual.d : kInfinite;
  }
  for (auto& column : new_group.horizon) std::fill_n(column, HorizonGroup::kSize, DiscLight::kNoHorizon);
  new_group.raised = false;
  return slots_[group];
}

// Finds the groups of samples before whose disc the edge may stand, and raises their horizons.
void Horizons::raise_behind(const Edge& edge, const double* origin, float lowest) {
  const auto coordinate = [&](const float* end, int k) { return end[k] + static_cast<float>(origin[k]); };
  const auto [u_low, u_high] = std::minmax({coordinate(edge.from, 0), coordinate(edge.to, 0)});
  const auto [v_low, v_high] = std::minmax({coordinate(edge.from, 1), coordinate(edge.to, 1)});
  Window window;
  if (!find_window({u_low, u_high, v_low, v_high, std::max(coordinate(edge.from, 2), coordinate(edge.to, 2))}, lowest,
                   window))
    return;
  group_slots_.clear();
  std::size_t done = 0;  // groups before this index are listed already
  for (int r = window.r0; r <= window.r1; ++r) {
    const std::size_t row = static_cast<std::size_t>(r) * static_cast<std::size_t>(band_->columns);
    const std::size_t first = band_->start[row + static_cast<std::size_t>(window.c0)];
    const std::size_t past = band_->start[row + static_cast<std::size_t>(window.c1) + 1];
    if (first == past) continue;
    for (std::size_t g = std::max(first / HorizonGroup::kSize, done); g * HorizonGroup::kSize < past; ++g) {
      done = g + 1;
      group_slots_.push_back(slot_of(g));
    }
  }
  HWY_DYNAMIC_DISPATCH(RaiseHorizons)(edge, origin, reach_, group_slots_.data(), group_slots_.size(), groups_.data());
}

void Horizons::add(const RasterMesh& mesh, const Strip& strip, const LightBox& bounds) {
  Window window;
  if (!find_window(bounds, lowest_, window)) return;
  const MeshBlock& block = *mesh.pieces()[strip.block]->shape->mesh_block;
  const dem::Block& posts = *block.posts;
  const int quads = block.side - 1;
  // Place the origin at the height of the ground: relative to the datum, float could not resolve a horizon next to a
  // sample.
  const Vec3 middle = posts.position(strip.first_row + strip.rows / 2, quads / 2,
                                     (static_cast<double>(posts.min_m) + static_cast<double>(posts.max_m)) / 2);
  const Vec3 from_anchor = middle - mesh.anchor();
  const double origin[3] = {axes_.u.dot(from_anchor), axes_.v.dot(from_anchor), axes_.d.dot(from_anchor)};
  const EastNorthUp axes{axes_.u, axes_.v, axes_.d};

  HorizonRow rows[3];  // row r of the block is rows[r % 3]
  LocalRow local;
  const auto load_row = [&](int r, HorizonRow& out) {
    constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
    for (float* line : {out.u, out.v, out.d}) std::fill_n(line, HorizonRow::kCapacity, kNaN);
    if (r < 0 || r > quads) return;
    const auto at = static_cast<std::size_t>(r);
    local_row(&block.vertices[posts.index(r, 0)], block.side,
              {posts.cos_lat[at], posts.sin_lat[at], posts.cos_lon.data(), posts.sin_lon.data()}, middle, axes, local);
    const auto place_vertex = [&](int c) {
      const Vec3 vertex = block.vertex(r, c) - middle;
      local.set(c, {axes_.u.dot(vertex), axes_.v.dot(vertex), axes_.d.dot(vertex)});
    };
    // Vertices of the border that have collapsed onto others are not where local_row() puts them.
    if (block.collapses) {
      place_vertex(0);
      place_vertex(quads);
      if (r == 0 || r == quads)
        for (int c = 1; c < quads; ++c) place_vertex(c);
    }
    std::copy_n(local.east, block.side, out.u + HorizonRow::kBefore);
    std::copy_n(local.north, block.side, out.v + HorizonRow::kBefore);
    std::copy_n(local.up, block.side, out.d + HorizonRow::kBefore);
  };

  const float aside = reach_.aside * (bounds.d_high - window.lowest) + 2 * band_->margin_m;
  const auto shift = static_cast<float>(origin[1]);
  const float v_low = band_->v0 - aside - shift;
  const float v_high = band_->v_end() + aside - shift;
  edges_.resize(kMaxEdges);
  load_row(strip.first_row - 1, rows[(strip.first_row + 2) % 3]);
  load_row(strip.first_row, rows[strip.first_row % 3]);
  // Include the row beyond the northernmost quads: it yields the edges of the northern border.
  const int last = strip.first_row + strip.rows == quads ? quads : strip.first_row + strip.rows - 1;
  for (int r = strip.first_row; r <= last; ++r) {
    load_row(r + 1, rows[(r + 1) % 3]);
    const std::size_t n = HWY_DYNAMIC_DISPATCH(FindEdges)(rows[(r + 2) % 3], rows[r % 3], rows[(r + 1) % 3], quads,
                                                          reach_, v_low, v_high, edges_.data());
    for (std::size_t i = 0; i < n; ++i) raise_behind(edges_[i], origin, window.lowest);
  }
}

bool Horizons::of_group(std::size_t group, float (*out)[HorizonGroup::kSize]) const {
  if (slots_[group] < 0) return false;
  const HorizonGroup& from = groups_[static_cast<std::size_t>(slots_[group])];
  if (!from.raised) return false;
  HWY_DYNAMIC_DISPATCH(RelativeToDisc)(from, reach_, out);
  return true;
}

std::size_t Horizons::bytes() const {
  return bytes_of(slots_) + bytes_of(groups_) + bytes_of(edges_) + bytes_of(group_slots_);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
