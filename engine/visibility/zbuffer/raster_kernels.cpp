#include "engine/visibility/zbuffer/raster_kernels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/zbuffer/raster_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "engine/visibility/zbuffer/to_front.h"

#ifndef SELENOGRAPH_HOMOGENEOUS_TRIANGLE
#define SELENOGRAPH_HOMOGENEOUS_TRIANGLE
namespace selenograph::engine {
// A triangle that is too large, too near or partly behind the eye for pixel positions in float. It has homogeneous
// edges in double (Olano and Greer, Triangle scan conversion using 2D homogeneous coordinates, 1997) and is never
// clipped. An edge between two vertices inside the guard band is tested in float exactly as whole strips test it, so
// that strips and single triangles join without gaps.
struct HomogeneousTriangle {
  // Coefficients of a function of the pixel (px, py): x * px + y * py + constant.
  struct Plane {
    double x, y, constant;
  };
  struct Edge {
    bool in_guard_band;    // both ends are: use the float members, otherwise `plane`
    bool flip;             // the edge function is negative inside
    float ox, oy, ex, ey;  // origin and extent in pixels
    Plane plane;
  };
  static constexpr int kMaxPixels = 128;  // pixels that DrawHomogeneous takes at a time
  Edge edges[3];
  Plane inverse;                // 1 / depth, per metre
  double near0, near1, offset;  // nearness as in TileView: near0 / depth - near1 (1 - offset / depth)
  std::uint32_t id;             // TriangleId::packed()
};
}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using F = hn::CappedTag<float, 16>;
using I = hn::RebindToSigned<F>;
using VF = hn::Vec<F>;
using VI = hn::Vec<I>;
using MF = hn::Mask<F>;

constexpr F float_tag;
constexpr I int_tag;
constexpr int kMaxColumns = 96;  // vertices of a row, padding included

HWY_INLINE VF broadcast(float x) { return hn::Set(float_tag, x); }

// A vector of triangles. Each has three edges: origin (ox, oy) and extent (ex, ey). After orient_edges a sample is
// inside if it is on the left of all three or on them. The plane is that of a value over the triangle: nearness in a
// tile, d in light space.
struct Triangles {
  // A defaulted constructor would not be compiled for Highway's target.
  HWY_INLINE Triangles() {}  // NOLINT(modernize-use-equals-default)
  VF ox[3], oy[3], ex[3], ey[3];
  VF px, py, p, gx, gy;  // value p at (px, py), and its gradient
};

// Returns twice the signed area of a triangle from the coordinates of its corners {a, b, c} or, in the upper half,
// {d, b, c}: positive if a, b, c or d, c, b run counter-clockwise. It is the cross product of the eastward and the
// northward edge.
HWY_INLINE VF area_of(bool upper, const VF* x, const VF* y) {
  const VF east_x = upper ? hn::Sub(x[0], x[2]) : hn::Sub(x[1], x[0]);
  const VF east_y = upper ? hn::Sub(y[0], y[2]) : hn::Sub(y[1], y[0]);
  const VF north_x = upper ? hn::Sub(x[0], x[1]) : hn::Sub(x[2], x[0]);
  const VF north_y = upper ? hn::Sub(y[0], y[1]) : hn::Sub(y[2], y[0]);
  return hn::Sub(hn::Mul(east_x, north_y), hn::Mul(east_y, north_x));
}

// Returns the edges, not yet oriented, and the plane of a value over the corners {a, b, c} or, in the upper half,
// {d, b, c}. The edges start and end as in the drawing in raster_kernels.h. Sets `area` as area_of does.
HWY_INLINE Triangles set_up(bool upper, const VF* x, const VF* y, const VF* corner_value, VF& area) {
  const VF ax = x[0], ay = y[0], bx = x[1], by = y[1], cx = x[2], cy = y[2];
  const VF a = corner_value[0], b = corner_value[1], c = corner_value[2];
  Triangles t;
  if (!upper) {
    t.ox[0] = ax;
    t.oy[0] = ay;
    t.ex[0] = hn::Sub(bx, ax);
    t.ey[0] = hn::Sub(by, ay);
    t.ox[1] = ax;
    t.oy[1] = ay;
    t.ex[1] = hn::Sub(cx, ax);
    t.ey[1] = hn::Sub(cy, ay);
  } else {
    t.ox[0] = cx;
    t.oy[0] = cy;
    t.ex[0] = hn::Sub(ax, cx);
    t.ey[0] = hn::Sub(ay, cy);
    t.ox[1] = bx;
    t.oy[1] = by;
    t.ex[1] = hn::Sub(ax, bx);
    t.ey[1] = hn::Sub(ay, by);
  }
  t.ox[2] = bx;
  t.oy[2] = by;
  t.ex[2] = hn::Sub(cx, bx);
  t.ey[2] = hn::Sub(cy, by);
  area = area_of(upper, x, y);
  // Take the differences of value and position along the eastward (1) and the northward (2) edge, away from the corner
  // that they share: a in the lower half, d (passed as a) in the upper half. The gradient solves gx x1 + gy y1 =
  // value_1 and gx x2 + gy y2 = value_2, by Cramer's rule.
  const VF value_1 = upper ? hn::Sub(c, a) : hn::Sub(b, a), value_2 = upper ? hn::Sub(b, a) : hn::Sub(c, a);
  const VF x1 = upper ? hn::Neg(t.ex[0]) : t.ex[0], y1 = upper ? hn::Neg(t.ey[0]) : t.ey[0];
  const VF x2 = upper ? hn::Neg(t.ex[1]) : t.ex[1], y2 = upper ? hn::Neg(t.ey[1]) : t.ey[1];
  const VF scale = hn::Div(broadcast(1.F), area);
  t.gx = hn::Mul(hn::Sub(hn::Mul(value_1, y2), hn::Mul(value_2, y1)), scale);
  t.gy = hn::Mul(hn::Sub(hn::Mul(value_2, x1), hn::Mul(value_1, x2)), scale);
  t.px = ax;
  t.py = ay;
  t.p = a;
  return t;
}

// Reverses edges so that the inside is on the left of all three. `positive`: the triangle's area is positive. Then the
// inside of the lower half is left of its eastward edge, right of its northward edge and left of its diagonal; in the
// upper half the sides are exchanged.
HWY_INLINE void orient_edges(Triangles& t, bool upper, MF positive) {
  const MF flip_first = upper ? positive : hn::Not(positive), flip_second = upper ? hn::Not(positive) : positive;
  t.ex[0] = hn::IfThenElse(flip_first, hn::Neg(t.ex[0]), t.ex[0]);
  t.ey[0] = hn::IfThenElse(flip_first, hn::Neg(t.ey[0]), t.ey[0]);
  t.ex[1] = hn::IfThenElse(flip_second, hn::Neg(t.ex[1]), t.ex[1]);
  t.ey[1] = hn::IfThenElse(flip_second, hn::Neg(t.ey[1]), t.ey[1]);
  t.ex[2] = hn::IfThenElse(flip_first, hn::Neg(t.ex[2]), t.ex[2]);
  t.ey[2] = hn::IfThenElse(flip_first, hn::Neg(t.ey[2]), t.ey[2]);
}

// Returns the distance of the samples from an oriented edge times its length: positive on its left.
HWY_INLINE VF edge_value(const Triangles& t, int k, VF x, VF y) {
  return hn::Sub(hn::Mul(t.ex[k], hn::Sub(y, t.oy[k])), hn::Mul(t.ey[k], hn::Sub(x, t.ox[k])));
}

// Returns the lanes whose sample is on the left of all three oriented edges or on them.
HWY_INLINE MF inside(const Triangles& t, VF x, VF y) {
  const auto edge = [&](int k) HWY_ATTR { return hn::Ge(edge_value(t, k, x, y), hn::Zero(float_tag)); };
  return hn::And(edge(0), hn::And(edge(1), edge(2)));
}

// Returns the value of the plane at the samples.
HWY_INLINE VF value(const Triangles& t, VF x, VF y) {
  return hn::Add(t.p, hn::Add(hn::Mul(t.gx, hn::Sub(x, t.px)), hn::Mul(t.gy, hn::Sub(y, t.py))));
}

// Number of members of Triangles.
constexpr std::size_t kTriangleMembers = 17;

// Stores a vector of triangles, member by member: first ox, oy, ex, ey of each edge, then the plane.
HWY_INLINE void store_triangles(const Triangles& t, float* out, std::size_t lanes) {
  for (int k = 0; k < 3; ++k) {
    hn::StoreU(t.ox[k], float_tag, out + (4 * k + 0) * lanes);
    hn::StoreU(t.oy[k], float_tag, out + (4 * k + 1) * lanes);
    hn::StoreU(t.ex[k], float_tag, out + (4 * k + 2) * lanes);
    hn::StoreU(t.ey[k], float_tag, out + (4 * k + 3) * lanes);
  }
  hn::StoreU(t.px, float_tag, out + 12 * lanes);
  hn::StoreU(t.py, float_tag, out + 13 * lanes);
  hn::StoreU(t.p, float_tag, out + 14 * lanes);
  hn::StoreU(t.gx, float_tag, out + 15 * lanes);
  hn::StoreU(t.gy, float_tag, out + 16 * lanes);
}
// One triangle of a vector that store_triangles() stored. Its members are broadcast to all lanes when they are needed.
struct StoredTriangle {
  const float* stored;      // member k of lane l is stored[k * lanes + l]
  std::size_t lanes, lane;  // lanes of the vector; lane of this triangle
  HWY_INLINE VF member(int k) const { return broadcast(stored[static_cast<std::size_t>(k) * lanes + lane]); }
  HWY_INLINE void load_edges(Triangles& t) const {
    for (int k = 0; k < 3; ++k) {
      t.ox[k] = member(4 * k);
      t.oy[k] = member(4 * k + 1);
      t.ex[k] = member(4 * k + 2);
      t.ey[k] = member(4 * k + 3);
    }
  }
  HWY_INLINE void load_plane(Triangles& t) const {
    t.px = member(12);
    t.py = member(13);
    t.p = member(14);
    t.gx = member(15);
    t.gy = member(16);
  }
};

// ---- the view ------------------------------------------------------------------------------------------------------

// A row of vertices of a block in pixels of the tile.
struct ProjectedRow {
  alignas(64) float x[kMaxColumns];  // pixels
  alignas(64) float y[kMaxColumns];  // pixels
  alignas(64) float w[kMaxColumns];  // nearness
};

// Projects a row of vertices, padding included, by the formulas at TileView. HomogeneousDrawer::corner repeats these
// operations in this order, so that strips and single triangles get the same pixels.
HWY_INLINE void project_row(const RasterBlock& b, int row, const TileView& view, ProjectedRow& out) {
  const std::size_t first = static_cast<std::size_t>(row) * static_cast<std::size_t>(b.stride);
  const auto dot_view_row = [&](int k, VF x, VF y, VF z) {
    return hn::Add(hn::Mul(broadcast(view.row[k][0]), x),
                   hn::Add(hn::Mul(broadcast(view.row[k][1]), y), hn::Mul(broadcast(view.row[k][2]), z)));
  };
  const VF near0 = broadcast(view.near0), near1 = broadcast(view.near1);
  for (int c = 0; c < b.stride; c += static_cast<int>(hn::Lanes(float_tag))) {
    const std::size_t at = first + static_cast<std::size_t>(c);
    const VF x = hn::Sub(hn::LoadU(float_tag, b.x + at), broadcast(view.pivot[0]));
    const VF y = hn::Sub(hn::LoadU(float_tag, b.y + at), broadcast(view.pivot[1]));
    const VF z = hn::Sub(hn::LoadU(float_tag, b.z + at), broadcast(view.pivot[2]));
    const VF beyond_pivot = dot_view_row(2, x, y, z);  // metres along the boresight
    const VF inverse_depth = hn::Div(broadcast(1.F), hn::Add(beyond_pivot, broadcast(view.offset[2])));
    const VF column = hn::Mul(hn::Add(dot_view_row(0, x, y, z), broadcast(view.offset[0])), inverse_depth);
    const VF line = hn::Mul(hn::Add(dot_view_row(1, x, y, z), broadcast(view.offset[1])), inverse_depth);
    hn::Store(column, float_tag, out.x + c);
    hn::Store(line, float_tag, out.y + c);
    hn::Store(hn::Mul(hn::Sub(near0, hn::Mul(near1, beyond_pivot)), inverse_depth), float_tag, out.w + c);
  }
}

// Projects a row of vertices, each in the row of the image that sees it, by the formulas at RowMotion.
// HomogeneousDrawer::moving_corner repeats these operations in this order.
HWY_NOINLINE void project_moving_row(const RasterBlock& b, int row, const TileView& view, ProjectedRow& out) {
  const RowMotion& motion = *view.motion;
  const std::size_t first = static_cast<std::size_t>(row) * static_cast<std::size_t>(b.stride);
  const VF near0 = broadcast(view.near0), near1 = broadcast(view.near1);
  const VF reach = broadcast(motion.reach), minus_reach = hn::Neg(reach);
  for (int c = 0; c < b.stride; c += static_cast<int>(hn::Lanes(float_tag))) {
    const std::size_t at = first + static_cast<std::size_t>(c);
    const VF x = hn::Sub(hn::LoadU(float_tag, b.x + at), broadcast(view.pivot[0]));
    const VF y = hn::Sub(hn::LoadU(float_tag, b.y + at), broadcast(view.pivot[1]));
    const VF z = hn::Sub(hn::LoadU(float_tag, b.z + at), broadcast(view.pivot[2]));
    const auto dot = [&](const float* form) HWY_ATTR {
      return hn::Add(hn::Mul(broadcast(form[0]), x),
                     hn::Add(hn::Mul(broadcast(form[1]), y), hn::Mul(broadcast(form[2]), z)));
    };
    const auto constant = [&](const float* form) HWY_ATTR { return broadcast(form[3]); };
    const auto form = [&](const float* f) HWY_ATTR { return hn::Add(dot(f), constant(f)); };
    const auto polynomial = [](VF p0, VF p1, VF p2, VF r)
                                HWY_ATTR { return hn::Add(p0, hn::Mul(r, hn::Add(p1, hn::Mul(r, p2)))); };
    const auto within_reach = [&](VF r) HWY_ATTR { return hn::Min(hn::Max(r, minus_reach), reach); };
    const VF f0 = form(motion.off_row[0]), f1 = form(motion.off_row[1]), f2 = form(motion.off_row[2]);
    const VF d0 = dot(motion.depth[0]), d1 = dot(motion.depth[1]), d2 = dot(motion.depth[2]);
    const VF f3 = hn::Neg(hn::Add(d2, constant(motion.depth[2])));
    const auto off_row = [&](VF r) HWY_ATTR { return hn::Add(f0, hn::Mul(r, polynomial(f1, f2, f3, r))); };
    VF r = within_reach(hn::Neg(hn::Div(f0, f1)));
    const VF slope = polynomial(f1, hn::Add(f2, f2), hn::Mul(broadcast(3.F), f3), r);
    r = within_reach(hn::Sub(r, hn::Div(off_row(r), slope)));
    const VF beyond_pivot = polynomial(d0, d1, d2, r);  // metres along the boresight
    const VF offset = polynomial(constant(motion.depth[0]), constant(motion.depth[1]), constant(motion.depth[2]), r);
    const VF inverse_depth = hn::Div(broadcast(1.F), hn::Add(beyond_pivot, offset));
    const VF column =
        hn::Mul(polynomial(form(motion.column[0]), form(motion.column[1]), form(motion.column[2]), r), inverse_depth);
    const VF line = hn::Add(hn::Add(r, broadcast(motion.middle)), hn::Mul(off_row(r), inverse_depth));
    hn::Store(column, float_tag, out.x + c);
    hn::Store(line, float_tag, out.y + c);
    hn::Store(hn::Mul(hn::Sub(near0, hn::Mul(near1, beyond_pivot)), inverse_depth), float_tag, out.w + c);
  }
}

// Returns whether triangle `id` wins over the triangle `drawn` of the same nearness. The order is that in which vectors
// of sixteen quads draw, so the image is the same at every vector width: by block, row, group of sixteen quads, half,
// and column in the group. The last five bits of TriangleId::packed() are column and half; the key rotates them so that
// the half comes first.
HWY_INLINE bool precedes(std::uint32_t id, std::uint32_t drawn) {
  const auto key = [](std::uint32_t packed) { return (packed & ~31U) | (packed & 1) << 4 | (packed >> 1 & 15); };
  return key(id) < key(drawn);
}
HWY_INLINE MF precede(VI id, VI drawn) {
  // Flip the top bits: a signed comparison then orders unsigned keys.
  const auto key = [](VI packed) {
    const VI column_in_group = hn::And(hn::ShiftRight<1>(packed), hn::Set(int_tag, 15));
    const VI half = hn::ShiftLeft<4>(hn::And(packed, hn::Set(int_tag, 1)));
    const VI rest = hn::AndNot(hn::Set(int_tag, 31), packed);
    return hn::Xor(hn::Or(rest, hn::Or(half, column_in_group)),
                   hn::Set(int_tag, std::numeric_limits<std::int32_t>::min()));
  };
  return hn::RebindMask(float_tag, hn::Lt(key(id), key(drawn)));
}

// Draws one large triangle row by row, a vector of pixels at a time. Its box is the pixels (x0, y0) to (x1, y1).
HWY_NOINLINE void fill_row_by_row(const StoredTriangle& triangle, int x0, int x1, int y0, int y1, std::uint32_t id,
                                  const TileView& view, TileBuffer& out) {
  Triangles t;
  triangle.load_edges(t);
  triangle.load_plane(t);
  const int width = view.width;
  const int lanes = static_cast<int>(hn::Lanes(float_tag));
  const VF ramp = hn::Iota(float_tag, 0.F);
  const VI triangle_id = hn::Set(int_tag, static_cast<std::int32_t>(id));
  for (int y = y0; y <= y1; ++y) {
    const VF py = broadcast(static_cast<float>(y));
    for (int x = x0; x <= x1; x += lanes) {
      const VF px = hn::Add(broadcast(static_cast<float>(x)), ramp);
      const std::size_t first_pixel =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
      const VF vx = view.sample_x ? hn::LoadU(float_tag, view.sample_x + first_pixel) : px;
      const VF vy = view.sample_y ? hn::LoadU(float_tag, view.sample_y + first_pixel) : py;
      // The last vector of a row extends beyond the box, and perhaps beyond the tile.
      MF wins = hn::And(inside(t, vx, vy), hn::Le(px, broadcast(static_cast<float>(x1))));
      if (hn::AllFalse(float_tag, wins)) continue;
      float* nearest = out.nearness.data() + first_pixel;
      auto* ids = reinterpret_cast<std::int32_t*>(out.triangle.data() + first_pixel);
      const VF nearness = value(t, vx, vy), drawn_nearness = hn::LoadU(float_tag, nearest);
      const MF equal = hn::And(wins, hn::Eq(nearness, drawn_nearness));
      wins = hn::And(wins, hn::Gt(nearness, drawn_nearness));
      if (HWY_UNLIKELY(!hn::AllFalse(float_tag, equal)))
        wins = hn::Or(wins, hn::And(equal, precede(triangle_id, hn::LoadU(int_tag, ids))));
      hn::BlendedStore(nearness, wins, float_tag, nearest);
      hn::BlendedStore(triangle_id, hn::RebindMask(int_tag, wins), int_tag, ids);
    }
  }
}

// Draws a vector of small triangles at once: each lane steps through the pixels of its own box, row by row. kSamples:
// pixels have samples off their centres. Hits are written one after the other, because two lanes may hit the same
// pixel.
template <bool kSamples>
HWY_INLINE void walk_boxes(const Triangles& t, MF active, VF x0, VF x1, VF y0, VF y1, VI ids, const TileView& view,
                           TileBuffer& out) {
  VF x = x0, y = y0;
  alignas(64) std::int32_t pixel[16] = {};
  alignas(64) std::int32_t triangle[16] = {};
  alignas(64) float nearness[16] = {};
  const VF step = broadcast(1.F), columns = broadcast(static_cast<float>(view.width));
  while (!hn::AllFalse(float_tag, active)) {
    const auto pixel_index = [&] {
      return hn::ConvertTo(int_tag, hn::IfThenElseZero(active, hn::Add(hn::Mul(y, columns), x)));
    };
    VF sx = x, sy = y;
    if constexpr (kSamples) {
      const VI at_sample = pixel_index();
      sx = hn::GatherIndex(float_tag, view.sample_x, at_sample);
      sy = hn::GatherIndex(float_tag, view.sample_y, at_sample);
    }
    const MF hit = hn::And(active, inside(t, sx, sy));
    if (!hn::AllFalse(float_tag, hit)) {
      const ToFront to_front(hit);
      hn::Store(to_front(pixel_index()), int_tag, pixel);
      hn::Store(to_front(ids), int_tag, triangle);
      hn::Store(to_front(value(t, sx, sy)), float_tag, nearness);
      const std::size_t n = hn::CountTrue(float_tag, hit);
      for (std::size_t k = 0; k < n; ++k) {
        const auto index = static_cast<std::size_t>(pixel[k]);
        const auto triangle_id = static_cast<std::uint32_t>(triangle[k]);
        if (nearness[k] > out.nearness[index]) {
          out.nearness[index] = nearness[k];
          out.triangle[index] = triangle_id;
        } else if (HWY_UNLIKELY(nearness[k] == out.nearness[index]) && precedes(triangle_id, out.triangle[index]))
          out.triangle[index] = triangle_id;
      }
    }
    x = hn::Add(x, step);
    const MF next = hn::Gt(x, x1);
    x = hn::IfThenElse(next, x0, x);
    y = hn::IfThenElse(next, hn::Add(y, step), y);
    active = hn::And(active, hn::Le(y, y1));
  }
}

constexpr float kMaxWalkedPixels = 24;  // pixels; larger boxes are filled row by row

// Draws a vector of triangles with corners at the pixels (x, y) and nearness w: large ones row by row, all others
// together. `upper`: the corners are {d, b, c}, otherwise {a, b, c}. `valid`: the lanes that have a triangle.
template <bool upper>
HWY_NOINLINE void draw_triangles(const VF* x, const VF* y, const VF* w, VI ids, MF valid, const TileView& view,
                                 TileBuffer& out) {
  // Clip the boxes of the triangles to the tile.
  const VF right = broadcast(static_cast<float>(view.width - 1));
  const VF bottom = broadcast(static_cast<float>(view.height - 1));
  const VF slack_x = broadcast(view.slack[0]), slack_y = broadcast(view.slack[1]);
  const VF x0 = hn::Max(hn::Ceil(hn::Sub(hn::Min(x[0], hn::Min(x[1], x[2])), slack_x)), hn::Zero(float_tag));
  const VF x1 = hn::Min(hn::Floor(hn::Add(hn::Max(x[0], hn::Max(x[1], x[2])), slack_x)), right);
  const VF y0 = hn::Max(hn::Ceil(hn::Sub(hn::Min(y[0], hn::Min(y[1], y[2])), slack_y)), hn::Zero(float_tag));
  const VF y1 = hn::Min(hn::Floor(hn::Add(hn::Max(y[0], hn::Max(y[1], y[2])), slack_y)), bottom);
  MF active = hn::And(valid, hn::And(hn::Le(x0, x1), hn::Le(y0, y1)));
  if (hn::AllFalse(float_tag, active)) return;
  VF area;
  Triangles t = set_up(upper, x, y, w, area);
  active = hn::And(active, hn::Ne(area, hn::Zero(float_tag)));
  // Rows of pixels run down, so a triangle that is counter-clockwise on the ground is clockwise here. orient_edges
  // needs only the sign in the image: triangles are two-sided.
  orient_edges(t, upper, hn::Gt(area, hn::Zero(float_tag)));
  const VF pixels = hn::Mul(hn::Add(hn::Sub(x1, x0), broadcast(1.F)), hn::Add(hn::Sub(y1, y0), broadcast(1.F)));
  const MF large = hn::And(active, hn::Gt(pixels, broadcast(kMaxWalkedPixels)));
  if (!hn::AllFalse(float_tag, large)) {
    const std::size_t lanes = hn::Lanes(float_tag);
    alignas(64) float stored[kTriangleMembers * 16];
    alignas(64) float box[4][16];  // x0, x1, y0, y1
    alignas(64) std::int32_t id[16];
    alignas(64) std::int32_t mask[16];
    store_triangles(t, stored, lanes);
    hn::Store(x0, float_tag, box[0]);
    hn::Store(x1, float_tag, box[1]);
    hn::Store(y0, float_tag, box[2]);
    hn::Store(y1, float_tag, box[3]);
    hn::Store(ids, int_tag, id);
    hn::Store(hn::IfThenElse(hn::RebindMask(int_tag, large), hn::Set(int_tag, 1), hn::Zero(int_tag)), int_tag, mask);
    for (std::size_t k = 0; k < lanes; ++k)
      if (mask[k])
        fill_row_by_row({stored, lanes, k}, static_cast<int>(box[0][k]), static_cast<int>(box[1][k]),
                        static_cast<int>(box[2][k]), static_cast<int>(box[3][k]), static_cast<std::uint32_t>(id[k]),
                        view, out);
    active = hn::AndNot(large, active);
  }
  if (view.sample_x)
    walk_boxes<true>(t, active, x0, x1, y0, y1, ids, view, out);
  else
    walk_boxes<false>(t, active, x0, x1, y0, y1, ids, view, out);
}

// Returns false for NaN: missing vertices are NaN.
HWY_INLINE MF is_number(VF x) { return hn::Eq(x, x); }

// Collects triangles until there is a full vector of them: in most vectors of quads few lanes have pixels or face away
// from the Sun.
class TriangleBatch {
 public:
  // A vector of triangles: three corners with two coordinates and a value each. For the image, x, y and w are pixels
  // and nearness; for the shadow map, u, v and d.
  struct Corners {
    HWY_INLINE Corners() {}  // NOLINT(modernize-use-equals-default): as Triangles'
    VF x[3], y[3], w[3];
    VI id;  // TriangleId::packed()
  };

  // Adds the lanes in the mask. Calls process(corners, full mask) when a vector is full.
  template <typename Process>
  HWY_INLINE void add(const Corners& added, MF mask, const Process& process) {
    const std::size_t lanes = hn::Lanes(float_tag);
    if (hn::AllTrue(float_tag, mask)) return process(added, mask);
    const ToFront to_front(mask);
    const auto append = [&](int k, VF values) { hn::StoreU(to_front(values), float_tag, values_[k] + count_); };
    for (int k = 0; k < 3; ++k) {
      append(k, added.x[k]);
      append(3 + k, added.y[k]);
      append(6 + k, added.w[k]);
    }
    hn::StoreU(to_front(added.id), int_tag, ids_ + count_);
    count_ += hn::CountTrue(float_tag, mask);
    if (count_ < lanes) return;
    const MF all_lanes = hn::Eq(hn::Zero(float_tag), hn::Zero(float_tag));
    process(corners(), all_lanes);
    count_ -= lanes;
    for (float* values : values_) hn::Store(hn::Load(float_tag, values + lanes), float_tag, values);
    hn::Store(hn::Load(int_tag, ids_ + lanes), int_tag, ids_);
  }
  // Calls process for the triangles that remain, fewer than a vector.
  template <typename Process>
  HWY_INLINE void flush(const Process& process) {
    if (count_ > 0) process(corners(), hn::FirstN(float_tag, count_));
    count_ = 0;
  }

 private:
  HWY_INLINE Corners corners() const {
    Corners out;
    for (int k = 0; k < 3; ++k) {
      out.x[k] = hn::Load(float_tag, values_[k]);
      out.y[k] = hn::Load(float_tag, values_[3 + k]);
      out.w[k] = hn::Load(float_tag, values_[6 + k]);
    }
    out.id = hn::Load(int_tag, ids_);
    return out;
  }

  // The triangles, by member: x, y and w of the three corners. There are fewer than a vector of them before add(), and
  // two vectors at most in it.
  alignas(64) float values_[9][32] = {};
  alignas(64) std::int32_t ids_[32] = {};
  std::size_t count_ = 0;
};

// A vector of quads with corners a, b, c, d as in raster_kernels.h.
struct Quads {
  HWY_INLINE Quads() {}  // NOLINT(modernize-use-equals-default): as Triangles'
  VF x[4], y[4], w[4];   // pixels, pixels, nearness
  MF lower, upper;       // triangles with all vertices present whose box contains a pixel of the tile
};

// Loads a vector of quads from column c on. Returns false, without nearness, if none may have a pixel of the tile.
HWY_INLINE bool load_quads(const ProjectedRow& south, const ProjectedRow& north, int c, const TileView& view,
                           Quads& q) {
  const auto corners = [&](const float* south_row, const float* north_row, VF* abcd) {
    abcd[0] = hn::Load(float_tag, south_row + c);
    abcd[1] = hn::LoadU(float_tag, south_row + c + 1);
    abcd[2] = hn::Load(float_tag, north_row + c);
    abcd[3] = hn::LoadU(float_tag, north_row + c + 1);
  };
  corners(south.x, north.x, q.x);
  corners(south.y, north.y, q.y);
  const MF diagonal = hn::And(is_number(q.x[1]), is_number(q.x[2]));
  q.lower = hn::And(diagonal, is_number(q.x[0]));
  q.upper = hn::And(diagonal, is_number(q.x[3]));
  // Bound the pixels of both halves exactly as draw_triangles does. `v`: x or y of the corners; `last`: the tile's last
  // column or row.
  const auto cull_by_axis = [&](const VF* v, float slack, int last, MF& lower, MF& upper) {
    const VF reach = broadcast(slack);
    const VF end = broadcast(static_cast<float>(last));
    const VF diagonal_low = hn::Min(v[1], v[2]);
    const VF diagonal_high = hn::Max(v[1], v[2]);
    const auto covers_pixel = [&](VF corner) {
      const VF low = hn::Max(hn::Ceil(hn::Sub(hn::Min(corner, diagonal_low), reach)), hn::Zero(float_tag));
      const VF high = hn::Min(hn::Floor(hn::Add(hn::Max(corner, diagonal_high), reach)), end);
      return hn::Le(low, high);
    };
    lower = hn::And(lower, covers_pixel(v[0]));
    upper = hn::And(upper, covers_pixel(v[3]));
  };
  cull_by_axis(q.x, view.slack[0], view.width - 1, q.lower, q.upper);
  cull_by_axis(q.y, view.slack[1], view.height - 1, q.lower, q.upper);
  if (hn::AllFalse(float_tag, hn::Or(q.lower, q.upper))) return false;
  corners(south.w, north.w, q.w);
  return true;
}

// Draws a strip inside the guard band. Both halves of the quads are batched separately, because `upper` is a template
// parameter of what draws them.
void DrawStrip(const RasterBlock& b, const Strip& strip, const TileView& view, TileBuffer& out) {
  ProjectedRow rows[2];  // in turns: the northern row of one step is the southern row of the next
  TriangleBatch lower, upper;
  const int lanes = static_cast<int>(hn::Lanes(float_tag));
  const auto draw_lower = [&](const TriangleBatch::Corners& t, MF valid)
                              HWY_ATTR { draw_triangles<false>(t.x, t.y, t.w, t.id, valid, view, out); };
  const auto draw_upper = [&](const TriangleBatch::Corners& t, MF valid)
                              HWY_ATTR { draw_triangles<true>(t.x, t.y, t.w, t.id, valid, view, out); };
  const auto project = [&](int r, ProjectedRow& row) HWY_ATTR {
    view.motion ? project_moving_row(b, r, view, row) : project_row(b, r, view, row);
  };
  project(strip.first_row, rows[0]);
  for (int r = strip.first_row; r < strip.first_row + strip.rows; ++r) {
    const ProjectedRow &south = rows[(r - strip.first_row) & 1], &north = rows[(r + 1 - strip.first_row) & 1];
    project(r + 1, rows[(r + 1 - strip.first_row) & 1]);
    for (int c = 0; c < b.quads; c += lanes) {
      Quads q;
      if (!load_quads(south, north, c, view, q)) continue;
      // Resolving the drawn pixels will read these vertices next; a cache line holds four.
      for (int i = 0; i < lanes; i += 4) __builtin_prefetch(b.vertices + (r + 1) * (b.quads + 1) + c + i, 0, 3);
      TriangleBatch::Corners t;
      // In packed ids the last bit is the half, and the column follows: neighbours in a row are two apart.
      t.id = hn::Add(hn::Set(int_tag, static_cast<std::int32_t>(TriangleId(strip.block, r, c, false).packed())),
                     hn::ShiftLeft<1>(hn::Iota(int_tag, 0)));
      for (int k = 0; k < 3; ++k) {
        t.x[k] = q.x[k];
        t.y[k] = q.y[k];
        t.w[k] = q.w[k];
      }
      if (!hn::AllFalse(float_tag, q.lower)) lower.add(t, q.lower, draw_lower);
      if (hn::AllFalse(float_tag, q.upper)) continue;
      t.x[0] = q.x[3];
      t.y[0] = q.y[3];
      t.w[0] = q.w[3];
      t.id = hn::Add(t.id, hn::Set(int_tag, 1));
      upper.add(t, q.upper, draw_upper);
    }
  }
  lower.flush(draw_lower);
  upper.flush(draw_upper);
}

// ---- the Sun -------------------------------------------------------------------------------------------------------

// A row of vertices of a block in light space.
struct LightRow {
  alignas(64) float u[kMaxColumns];
  alignas(64) float v[kMaxColumns];
  alignas(64) float d[kMaxColumns];
};

HWY_INLINE void to_light_space(const RasterBlock& b, int row, const LightAxes& axes, LightRow& out) {
  const std::size_t first = static_cast<std::size_t>(row) * static_cast<std::size_t>(b.stride);
  for (int c = 0; c < b.stride; c += static_cast<int>(hn::Lanes(float_tag))) {
    const std::size_t at = first + static_cast<std::size_t>(c);
    const VF x = hn::LoadU(float_tag, b.x + at), y = hn::LoadU(float_tag, b.y + at), z = hn::LoadU(float_tag, b.z + at);
    const auto dot = [&](const float* a) {
      return hn::Add(hn::Mul(broadcast(a[0]), x), hn::Add(hn::Mul(broadcast(a[1]), y), hn::Mul(broadcast(a[2]), z)));
    };
    hn::Store(dot(axes.u), float_tag, out.u + c);
    hn::Store(dot(axes.v), float_tag, out.v + c);
    hn::Store(dot(axes.d), float_tag, out.d + c);
  }
}

// Returns the column or row of cells of a coordinate, clamped to the grid.
HWY_INLINE VI cell_index(VF x, float first, float per_metre, int last) {
  const VF at = hn::Floor(hn::Mul(hn::Sub(x, broadcast(first)), broadcast(per_metre)));
  return hn::ConvertTo(int_tag, hn::Min(hn::Max(at, hn::Zero(float_tag)), broadcast(static_cast<float>(last))));
}

// Returns the smallest of a sample's three edge values, which is at least 0 inside the triangle and on its edges.
HWY_INLINE VF min_edge_value(const Triangles& t, VF u, VF v) {
  return hn::Min(edge_value(t, 0, u, v), hn::Min(edge_value(t, 1, u, v), edge_value(t, 2, u, v)));
}

// An occluder in light space: a StoredTriangle, followed by four members that only a triangle with a foot (see at_foot)
// has.
struct StoredOccluder : StoredTriangle {
  static constexpr std::size_t kMembers = kTriangleMembers + 4;
  // Returns the smallest edge value of a sample within reach, m^2.
  HWY_INLINE VF min_edge_value() const { return member(17); }
  // Returns the usual error of a sample's u, v and d relative to the occluder, m.
  HWY_INLINE VF reach_m() const { return member(18); }
  // Returns d of corner k of {a, b, c} or {d, b, c}, as in set_up: the plane's value p is that of the first.
  HWY_INLINE VF corner_d(int k) const { return member(k == 0 ? 14 : 18 + k); }
};

// Returns those of the samples outside a triangle that rounding has moved across the foot of the slope that it is part
// of. No other triangle would shadow them. They are within reach of an edge, and slightly below it in d: samples next
// to a crest are above it, or far below.
//
//                       . '  ray toward the Sun
//    sample         . '  /
//       *-__    . '     /   slope, nearly edge-on: it rises slightly more steeply than the ray
//           ``--__     /
//                 ``--/
//                    foot
template <bool upper>
HWY_NOINLINE MF at_foot(const StoredOccluder& occluder, VF u, VF v, VF d, MF samples) {
  // Corners from which the edges start, and where they end.
  constexpr int kFirst[3] = {upper ? 2 : 0, upper ? 1 : 0, 1}, kLast[3] = {upper ? 0 : 1, upper ? 0 : 2, 2};
  constexpr float kMinFacing = 1 / 1024.F;  // sine of the Sun's elevation over the ground at the foot
  Triangles t;
  occluder.load_edges(t);
  const VF reach_m = occluder.reach_m(), max_depth_m = hn::Mul(reach_m, broadcast(1 / kMinFacing));
  MF within_reach = samples;
  MF below = hn::FirstN(float_tag, 0);
  for (int k = 0; k < 3; ++k) {
    const VF outside = hn::Min(edge_value(t, k, u, v), hn::Zero(float_tag));
    const VF length2 = hn::Add(hn::Mul(t.ex[k], t.ex[k]), hn::Mul(t.ey[k], t.ey[k]));
    const VF reach2 = hn::Mul(hn::Mul(reach_m, reach_m), length2);
    within_reach = hn::And(within_reach, hn::Le(hn::Mul(outside, outside), reach2));
    // Interpolate d along the edge: next to it, the plane is too steep to be evaluated.
    const VF along = hn::Add(hn::Mul(t.ex[k], hn::Sub(u, t.ox[k])), hn::Mul(t.ey[k], hn::Sub(v, t.oy[k])));
    const VF fraction = hn::Min(hn::Div(hn::Abs(along), length2), broadcast(1.F));
    const VF first_d = occluder.corner_d(kFirst[k]);
    const VF rise = hn::Sub(occluder.corner_d(kLast[k]), first_d);
    const VF depth = hn::Sub(hn::Add(first_d, hn::Mul(rise, fraction)), d);
    const MF is_foot = hn::And(hn::Gt(depth, reach_m), hn::Lt(depth, max_depth_m));
    below = hn::Or(below, hn::And(hn::Lt(outside, hn::Zero(float_tag)), is_foot));
  }
  return hn::And(within_reach, below);
}

// Marks the samples below one triangle as shadowed, in cells of columns c0 to c1 and rows r0 to r1 of the band. `foot`:
// also those at its foot.
template <bool upper, bool foot>
HWY_INLINE void shadow_samples(const StoredOccluder& occluder, int c0, int c1, int r0, int r1, LightBand& band) {
  Triangles t;
  occluder.load_edges(t);
  const VF threshold = foot ? occluder.min_edge_value() : hn::Zero(float_tag);
  const std::size_t lanes = hn::Lanes(float_tag);
  const VF dark = broadcast(std::numeric_limits<float>::infinity());
  for (int r = r0; r <= r1; ++r) {
    const std::size_t row = static_cast<std::size_t>(r) * static_cast<std::size_t>(band.columns);
    const std::size_t first = band.start[row + static_cast<std::size_t>(c0)];
    const std::size_t past_last = band.start[row + static_cast<std::size_t>(c1) + 1];
    for (std::size_t k = first; k < past_last; k += lanes) {
      const VF u = hn::LoadU(float_tag, band.u.data() + k), v = hn::LoadU(float_tag, band.v.data() + k);
      const VF from_edge = min_edge_value(t, u, v);
      const MF near = hn::Ge(from_edge, threshold);
      if (hn::AllFalse(float_tag, near)) continue;  // nine of ten vectors, where triangles are smaller than pixels
      occluder.load_plane(t);
      const VF d = hn::LoadU(float_tag, band.d.data() + k);
      const MF is_inside = foot ? hn::Ge(from_edge, hn::Zero(float_tag)) : near;
      MF shadowed = hn::And(is_inside, hn::Gt(value(t, u, v), d));
      if constexpr (foot) {
        const MF outside = hn::AndNot(is_inside, hn::And(near, hn::Lt(d, dark)));
        if (!hn::AllFalse(float_tag, outside)) shadowed = hn::Or(shadowed, at_foot<upper>(occluder, u, v, d, outside));
      }
      hn::BlendedStore(dark, shadowed, float_tag, band.d.data() + k);
    }
  }
}

// Returns the triangles that face away from the Sun: those with a negative area in light space.
HWY_INLINE MF faces_away(const VF* u, const VF* v, bool upper, MF valid) {
  return hn::And(valid, hn::Lt(area_of(upper, u, v), hn::Zero(float_tag)));
}

// Returns the triangles that face away from the Sun and overlap the band.
HWY_INLINE MF may_cast(const VF* u, const VF* v, bool upper, MF valid, const LightBand& band) {
  const auto overlaps = [](const VF* at, float first, float last) {
    return hn::And(hn::Ge(hn::Max(at[0], hn::Max(at[1], at[2])), broadcast(first)),
                   hn::Le(hn::Min(at[0], hn::Min(at[1], at[2])), broadcast(last)));
  };
  return hn::And(faces_away(u, v, upper, valid),
                 hn::And(overlaps(v, band.v0 - band.margin_m, band.v_end() + band.margin_m),
                         overlaps(u, band.u0 - band.margin_m, band.u_end() + band.margin_m)));
}

// Twice the usual rounding errors of u, v and d, relative to the distance from the anchor. Their product is the reach
// of rounding, m.
constexpr float kRounding = 0x1p-24F;
// Width of an occluder, in reaches of rounding, up to which samples at its foot are tested: where sunlight grazes the
// ground before a slope, it nearly grazes the slope, too.
constexpr float kThin = 1024;

// Shadows the samples of a band below a vector of triangles that passed may_cast. `relative_rounding`: kRounding, or 0
// for triangles without a foot.
template <bool upper>
HWY_NOINLINE void cast_triangles(const VF* u, const VF* v, const VF* d, MF active, float relative_rounding,
                                 LightBand& band) {
  const VF distance_m = hn::Add(hn::Abs(d[0]), hn::Add(hn::Abs(u[0]), hn::Abs(v[0])));
  const VF reach_m = hn::Mul(broadcast(relative_rounding), distance_m);
  const VF u_low = hn::Sub(hn::Min(u[0], hn::Min(u[1], u[2])), reach_m);
  const VF u_high = hn::Add(hn::Max(u[0], hn::Max(u[1], u[2])), reach_m);
  const VF v_low = hn::Sub(hn::Min(v[0], hn::Min(v[1], v[2])), reach_m);
  const VF v_high = hn::Add(hn::Max(v[0], hn::Max(v[1], v[2])), reach_m);
  VF area;
  Triangles t = set_up(upper, u, v, d, area);
  orient_edges(t, upper, hn::Gt(area, hn::Zero(float_tag)));
  const std::size_t lanes = hn::Lanes(float_tag);
  alignas(64) std::int32_t c0[16];
  alignas(64) std::int32_t c1[16];
  alignas(64) std::int32_t r0[16];
  alignas(64) std::int32_t r1[16];
  constexpr std::int32_t kInactive = 0, kCasts = 1, kHasFoot = 2;
  alignas(64) std::int32_t kind[16];
  alignas(64) float stored[StoredOccluder::kMembers * 16];
  alignas(64) float highest[16];
  hn::Store(cell_index(u_low, band.u0, band.per_u, band.columns - 1), int_tag, c0);
  hn::Store(cell_index(u_high, band.u0, band.per_u, band.columns - 1), int_tag, c1);
  hn::Store(cell_index(v_low, band.v0, band.per_v, band.rows - 1), int_tag, r0);
  hn::Store(cell_index(v_high, band.v0, band.per_v, band.rows - 1), int_tag, r1);
  hn::Store(hn::Max(d[0], hn::Max(d[1], d[2])), float_tag, highest);
  store_triangles(t, stored, lanes);
  // Bound the edge values of samples within reach of an edge: their distance from it times its length, which is at most
  // the width plus the height of the box.
  const VF within_reach = hn::Mul(reach_m, hn::Add(hn::Sub(u_high, u_low), hn::Sub(v_high, v_low)));
  const MF thin = hn::Lt(hn::Abs(area), hn::Mul(within_reach, broadcast(kThin)));
  if (!hn::AllFalse(float_tag, hn::And(active, thin))) {
    float* occluder_member = stored + kTriangleMembers * lanes;
    for (const VF values : {hn::Neg(within_reach), reach_m, d[1], d[2]}) {
      hn::StoreU(values, float_tag, occluder_member);
      occluder_member += lanes;
    }
  }
  const VI casts = hn::IfThenElse(hn::RebindMask(int_tag, thin), hn::Set(int_tag, kHasFoot), hn::Set(int_tag, kCasts));
  hn::Store(hn::IfThenElse(hn::RebindMask(int_tag, active), casts, hn::Set(int_tag, kInactive)), int_tag, kind);
  for (std::size_t k = 0; k < lanes; ++k) {
    if (kind[k] == kInactive || !band.any_below(c0[k], c1[k], r0[k], r1[k], highest[k])) continue;
    const StoredOccluder occluder{{stored, lanes, k}};
    if (kind[k] == kHasFoot)
      shadow_samples<upper, true>(occluder, c0[k], c1[k], r0[k], r1[k], band);
    else
      shadow_samples<upper, false>(occluder, c0[k], c1[k], r0[k], r1[k], band);
  }
}

// Casts a strip as cast_strip() says. Batches keep u, v and d of the corners as x, y and w; shadows need no ids.
void CastStrip(const RasterBlock& b, const Strip& strip, const LightAxes& axes, LightBand& band) {
  LightRow rows[2];  // in turns: the northern row of one step is the southern row of the next
  TriangleBatch lower, upper;
  const int lanes = static_cast<int>(hn::Lanes(float_tag));
  const auto cast_lower = [&](const TriangleBatch::Corners& t, MF active)
                              HWY_ATTR { cast_triangles<false>(t.x, t.y, t.w, active, kRounding, band); };
  const auto cast_upper = [&](const TriangleBatch::Corners& t, MF active)
                              HWY_ATTR { cast_triangles<true>(t.x, t.y, t.w, active, kRounding, band); };
  to_light_space(b, strip.first_row, axes, rows[0]);
  for (int r = strip.first_row; r < strip.first_row + strip.rows; ++r) {
    const LightRow &south = rows[(r - strip.first_row) & 1], &north = rows[(r + 1 - strip.first_row) & 1];
    to_light_space(b, r + 1, axes, rows[(r + 1 - strip.first_row) & 1]);
    for (int c = 0; c < b.quads; c += lanes) {
      TriangleBatch::Corners t;
      t.id = hn::Zero(int_tag);
      const auto corners = [&](const float* south_row, const float* north_row, VF* abc) HWY_ATTR {
        abc[0] = hn::Load(float_tag, south_row + c);
        abc[1] = hn::LoadU(float_tag, south_row + c + 1);
        abc[2] = hn::Load(float_tag, north_row + c);
      };
      corners(south.u, north.u, t.x);
      corners(south.v, north.v, t.y);
      const MF diagonal = hn::And(is_number(t.x[1]), is_number(t.x[2]));
      const MF lower_casts = may_cast(t.x, t.y, false, hn::And(diagonal, is_number(t.x[0])), band);
      // Replace corner a by d for the upper half, and keep a for the lower one.
      const VF south_west_u = t.x[0], south_west_v = t.y[0];
      t.x[0] = hn::LoadU(float_tag, north.u + c + 1);
      t.y[0] = hn::LoadU(float_tag, north.v + c + 1);
      const MF upper_casts = may_cast(t.x, t.y, true, hn::And(diagonal, is_number(t.x[0])), band);
      if (hn::AllFalse(float_tag, hn::Or(lower_casts, upper_casts))) continue;
      corners(south.d, north.d, t.w);
      const VF south_west_d = t.w[0];
      t.w[0] = hn::LoadU(float_tag, north.d + c + 1);
      if (!hn::AllFalse(float_tag, upper_casts)) upper.add(t, upper_casts, cast_upper);
      if (hn::AllFalse(float_tag, lower_casts)) continue;
      t.x[0] = south_west_u;
      t.y[0] = south_west_v;
      t.w[0] = south_west_d;
      lower.add(t, lower_casts, cast_lower);
    }
  }
  lower.flush(cast_lower);
  upper.flush(cast_upper);
}

// Bounds of the triangles that face away from the Sun, per column of quads.
struct ColumnBounds {
  alignas(64) float u_low[kMaxColumns];
  alignas(64) float u_high[kMaxColumns];
  alignas(64) float v_low[kMaxColumns];
  alignas(64) float v_high[kMaxColumns];
  alignas(64) float d_high[kMaxColumns];

  ColumnBounds() {
    constexpr float kInfinite = std::numeric_limits<float>::infinity();
    for (float* low : {u_low, v_low}) std::fill_n(low, kMaxColumns, kInfinite);
    for (float* high : {u_high, v_high, d_high}) std::fill_n(high, kMaxColumns, -kInfinite);
  }
  // Returns the box of some columns. Its u_low exceeds its u_high if no triangle there faces away.
  LightBox over(int first, int past_last) const {
    LightBox box{u_low[first], u_high[first], v_low[first], v_high[first], d_high[first]};
    for (int c = first + 1; c < past_last; ++c) {
      box.u_low = std::min(box.u_low, u_low[c]);
      box.u_high = std::max(box.u_high, u_high[c]);
      box.v_low = std::min(box.v_low, v_low[c]);
      box.v_high = std::max(box.v_high, v_high[c]);
      box.d_high = std::max(box.d_high, d_high[c]);
    }
    return box;
  }
};

// Extends the bounds of a vector of columns by the triangles between two rows, from column c on.
HWY_INLINE void extend_bounds(const LightRow& south, const LightRow& north, int c, ColumnBounds& bounds) {
  const auto corners = [&](const float* south_row, const float* north_row, VF* abcd) HWY_ATTR {
    abcd[0] = hn::Load(float_tag, south_row + c);
    abcd[1] = hn::LoadU(float_tag, south_row + c + 1);
    abcd[2] = hn::Load(float_tag, north_row + c);
    abcd[3] = hn::LoadU(float_tag, north_row + c + 1);
  };
  VF u[4], v[4], d[4];
  corners(south.u, north.u, u);
  corners(south.v, north.v, v);
  const MF diagonal = hn::And(is_number(u[1]), is_number(u[2]));
  const VF upper_u[3] = {u[3], u[1], u[2]}, upper_v[3] = {v[3], v[1], v[2]};
  const MF lower_faces_away = faces_away(u, v, false, hn::And(diagonal, is_number(u[0])));
  const MF upper_faces_away = faces_away(upper_u, upper_v, true, hn::And(diagonal, is_number(u[3])));
  if (hn::AllFalse(float_tag, hn::Or(lower_faces_away, upper_faces_away))) return;
  corners(south.d, north.d, d);
  const auto extend_low = [&](const VF* x, float* out) HWY_ATTR {
    const VF shared = hn::Min(x[1], x[2]), neutral = broadcast(std::numeric_limits<float>::infinity());
    const VF lower = hn::IfThenElse(lower_faces_away, hn::Min(x[0], shared), neutral);
    const VF upper = hn::IfThenElse(upper_faces_away, hn::Min(x[3], shared), neutral);
    hn::Store(hn::Min(hn::Load(float_tag, out + c), hn::Min(lower, upper)), float_tag, out + c);
  };
  const auto extend_high = [&](const VF* x, float* out) HWY_ATTR {
    const VF shared = hn::Max(x[1], x[2]), neutral = broadcast(-std::numeric_limits<float>::infinity());
    const VF lower = hn::IfThenElse(lower_faces_away, hn::Max(x[0], shared), neutral);
    const VF upper = hn::IfThenElse(upper_faces_away, hn::Max(x[3], shared), neutral);
    hn::Store(hn::Max(hn::Load(float_tag, out + c), hn::Max(lower, upper)), float_tag, out + c);
  };
  extend_low(u, bounds.u_low);
  extend_high(u, bounds.u_high);
  extend_low(v, bounds.v_low);
  extend_high(v, bounds.v_high);
  extend_high(d, bounds.d_high);
}

// Bounds groups of quads as bound_occluders() says: rows of groups from south to north, and in each from west to east.
std::size_t BoundOccluders(const RasterBlock& b, const Strip& strip, const LightAxes& axes, LightBox* boxes) {
  const int lanes = static_cast<int>(hn::Lanes(float_tag));
  LightRow rows[2];
  to_light_space(b, strip.first_row, axes, rows[0]);
  std::size_t count = 0;
  for (int first = 0; first < strip.rows; first += kOccluderBoxQuads) {
    ColumnBounds bounds;
    for (int r = first; r < std::min(first + kOccluderBoxQuads, strip.rows); ++r) {
      const LightRow& south = rows[r & 1];
      LightRow& north = rows[(r + 1) & 1];
      to_light_space(b, strip.first_row + r + 1, axes, north);
      for (int c = 0; c < b.quads; c += lanes) extend_bounds(south, north, c, bounds);
    }
    for (int c = 0; c < b.quads; c += kOccluderBoxQuads) {
      const LightBox box = bounds.over(c, std::min(c + kOccluderBoxQuads, b.quads));
      if (box.u_low <= box.u_high) boxes[count++] = box;
    }
  }
  return count;
}

// Casts one skirt, in the first lane, without a test of samples at its foot.
void CastSkirt(const Skirt& skirt, const LightAxes& axes, LightBand& band) {
  const auto dot = [](const float* a, const float* p) { return broadcast(a[0] * p[0] + a[1] * p[1] + a[2] * p[2]); };
  const VF u[3] = {dot(axes.u, skirt.a), dot(axes.u, skirt.b), dot(axes.u, skirt.c)};
  const VF v[3] = {dot(axes.v, skirt.a), dot(axes.v, skirt.b), dot(axes.v, skirt.c)};
  const VF d[3] = {dot(axes.d, skirt.a), dot(axes.d, skirt.b), dot(axes.d, skirt.c)};
  const MF active = may_cast(u, v, false, hn::FirstN(float_tag, 1), band);
  if (!hn::AllFalse(float_tag, active)) cast_triangles<false>(u, v, d, active, 0, band);
}

// Sets low and high to the range of n values: whole vectors first, the rest one by one.
void RangeOf(const float* x, std::size_t n, float& low, float& high) {
  const std::size_t lanes = hn::Lanes(float_tag);
  VF lowest = broadcast(x[0]), highest = lowest;
  std::size_t k = 0;
  for (; k + lanes <= n; k += lanes) {
    const VF v = hn::LoadU(float_tag, x + k);
    lowest = hn::Min(lowest, v);
    highest = hn::Max(highest, v);
  }
  low = hn::GetLane(hn::MinOfLanes(float_tag, lowest));
  high = hn::GetLane(hn::MaxOfLanes(float_tag, highest));
  for (; k < n; ++k) {
    low = std::min(low, x[k]);
    high = std::max(high, x[k]);
  }
}

// Updates band.min_d as update_coarse_min() says: the samples of kCoarse cells of a row are contiguous in band.d.
void UpdateCoarseMin(LightBand& band, int c0, int c1, int r0, int r1) {
  const std::size_t lanes = hn::Lanes(float_tag);
  for (int r = r0; r <= r1; ++r) {
    const std::uint32_t* start = &band.start[static_cast<std::size_t>(r) * static_cast<std::size_t>(band.columns)];
    for (int q = c0 / LightBand::kCoarse; q <= c1 / LightBand::kCoarse; ++q) {
      const std::size_t first = start[q * LightBand::kCoarse];
      const std::size_t past_last = start[std::min(band.columns, (q + 1) * LightBand::kCoarse)];
      VF lowest = broadcast(std::numeric_limits<float>::infinity());
      std::size_t k = first;
      for (; k + lanes <= past_last; k += lanes) lowest = hn::Min(lowest, hn::LoadU(float_tag, band.d.data() + k));
      if (k < past_last)
        lowest = hn::Min(lowest, hn::IfThenElse(hn::FirstN(float_tag, past_last - k),
                                                hn::LoadU(float_tag, band.d.data() + k), lowest));
      band.coarse_min_d(r, q) = hn::GetLane(hn::MinOfLanes(float_tag, lowest));
    }
  }
}

// ---- triangles with homogeneous edges -----------------------------------------------------------------------------

// Draws a triangle into n pixels of a row, whose samples are (sx, sy): the tile's pixels, in the order of `nearness`
// and `triangle`. Nearness is that of project_row, from 1 / depth instead of the position.
void DrawHomogeneous(const HomogeneousTriangle& t, const float* HWY_RESTRICT sx, const float* HWY_RESTRICT sy,
                     std::size_t n, float* HWY_RESTRICT nearness, std::uint32_t* HWY_RESTRICT triangle) {
  std::int32_t in[HomogeneousTriangle::kMaxPixels];
  std::fill_n(in, n, 1);
  for (const HomogeneousTriangle::Edge& edge : t.edges) {
    if (edge.in_guard_band) {
      const float ox = edge.ox;
      const float oy = edge.oy;
      const float ex = edge.ex;
      const float ey = edge.ey;
      const float sign = edge.flip ? -1 : 1;
      SELENOGRAPH_INDEPENDENT_LANES
      for (std::size_t i = 0; i < n; ++i) in[i] = sign * (ex * (sy[i] - oy) - ey * (sx[i] - ox)) >= 0 ? in[i] : 0;
    } else {
      const double x = edge.plane.x;
      const double y = edge.plane.y;
      const double constant = edge.plane.constant;
      const double sign = edge.flip ? -1 : 1;
      SELENOGRAPH_INDEPENDENT_LANES
      for (std::size_t i = 0; i < n; ++i)
        in[i] = sign * (x * static_cast<double>(sx[i]) + y * static_cast<double>(sy[i]) + constant) >= 0 ? in[i] : 0;
    }
  }
  const double ix = t.inverse.x;
  const double iy = t.inverse.y;
  const double i1 = t.inverse.constant;
  const double near0 = t.near0;
  const double near1 = t.near1;
  const double offset = t.offset;
  const std::uint32_t id = t.id;
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t i = 0; i < n; ++i) {
    const double inverse = ix * static_cast<double>(sx[i]) + iy * static_cast<double>(sy[i]) + i1;
    const auto pixel_nearness = static_cast<float>(near0 * inverse - near1 * (1 - offset * inverse));
    const bool nearer = in[i] != 0 && inverse > 0 && pixel_nearness > nearness[i];
    nearness[i] = nearer ? pixel_nearness : nearness[i];
    triangle[i] = nearer ? id : triangle[i];
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(DrawStrip);
HWY_EXPORT(DrawHomogeneous);
HWY_EXPORT(CastStrip);
HWY_EXPORT(CastSkirt);
HWY_EXPORT(BoundOccluders);
HWY_EXPORT(UpdateCoarseMin);
HWY_EXPORT(RangeOf);

void TileBuffer::clear(int width, int height) {
  const std::size_t n = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  nearness.assign(n + kTilePadding, kFarthest);  // vectors of pixels are stored past the last
  triangle.assign(n + kTilePadding, kNoTriangle);
}

namespace {

// Draws the triangles of a strip that leaves the guard band one by one.
class HomogeneousDrawer {
  using Plane = HomogeneousTriangle::Plane;
  using Edge = HomogeneousTriangle::Edge;

 public:
  HomogeneousDrawer(const RasterBlock& block, const TileView& view, TileBuffer& out)
      : block_(block), view_(view), out_(out) {}

  // Projects two rows of corners at a time. Most rows and triangles are rejected because all their corners lie outside
  // the same side of the tile.
  void draw_all(const Strip& strip) {
    unsigned south_outside = 0, north_outside = 0;
    for (int r = strip.first_row; r <= strip.first_row + strip.rows; ++r) {
      std::swap(south_, north_);
      south_outside = std::exchange(north_outside, ~0U);
      for (int c = 0; c <= block_.quads; ++c) {
        const Corner& here = north_[static_cast<std::size_t>(c)] = corner(r, c);
        if (!std::isnan(here.z)) north_outside &= here.outside;
      }
      if (r == strip.first_row || (south_outside & north_outside) != 0) continue;
      for (int c = 0; c < block_.quads; ++c)
        for (const bool upper : {false, true}) draw({strip.block, r - 1, c, upper});
    }
  }

 private:
  struct Corner {
    double x, y, z;  // homogeneous: x / z and y / z are the pixel
    float px, py;
    bool in_guard_band;  // otherwise px and py are meaningless
    unsigned outside;    // a bit each: behind the eye, left of, right of, above, below the tile
  };

  // Draws a triangle between the rows south_ and north_.
  void draw(const TriangleId& id) {
    const dem::QuadVertices q = id.vertices();
    const auto corner_of = [&](int k) -> const Corner& {
      return (q.r[k] == id.r() ? south_ : north_)[static_cast<std::size_t>(q.c[k])];
    };
    // Name the corners as in raster_kernels.h: a (or d), b, c.
    const Corner &a = corner_of(0), &b = corner_of(id.upper() ? 2 : 1), &c = corner_of(id.upper() ? 1 : 2);
    if (a.outside & b.outside & c.outside || std::isnan(a.z) || std::isnan(b.z) || std::isnan(c.z)) return;
    // Compute six times the volume of the tetrahedron from the eye to the triangle: the homogeneous equivalent of the
    // area, with the same sign. The edges are oriented by it as in orient_edges.
    const double volume = a.x * (b.y * c.z - b.z * c.y) - a.y * (b.x * c.z - b.z * c.x) + a.z * (b.x * c.y - b.y * c.x);
    if (volume == 0) return;
    const bool positive = (volume > 0) != id.upper();  // counter-clockwise are a, b, c or, in the upper half, d, c, b
    const bool flip = id.upper() == positive;
    // The sum of the three barycentric weights is 1 / depth at a pixel.
    const Plane n[3] = {plane(b, c), plane(c, a), plane(a, b)};
    const Plane inverse{(n[0].x + n[1].x + n[2].x) / volume, (n[0].y + n[1].y + n[2].y) / volume,
                        (n[0].constant + n[1].constant + n[2].constant) / volume};
    const HomogeneousTriangle triangle{{id.upper() ? edge(c, a, flip) : edge(a, b, flip),
                                        id.upper() ? edge(b, a, !flip) : edge(a, c, !flip), edge(b, c, flip)},
                                       inverse,
                                       static_cast<double>(view_.near0),
                                       static_cast<double>(view_.near1),
                                       static_cast<double>(view_.offset[2]),
                                       id.packed()};
    // Visit the whole tile unless pixel positions bound the triangle.
    int x0 = 0;
    int x1 = view_.width - 1;
    int y0 = 0;
    int y1 = view_.height - 1;
    if (a.in_guard_band && b.in_guard_band && c.in_guard_band) {
      const auto [aside, above] = view_.slack;
      x0 = std::max(x0, static_cast<int>(std::ceil(std::min({a.px, b.px, c.px}) - aside)));
      x1 = std::min(x1, static_cast<int>(std::floor(std::max({a.px, b.px, c.px}) + aside)));
      y0 = std::max(y0, static_cast<int>(std::ceil(std::min({a.py, b.py, c.py}) - above)));
      y1 = std::min(y1, static_cast<int>(std::floor(std::max({a.py, b.py, c.py}) + above)));
    }
    for (int y = y0; y <= y1; ++y) draw_row(triangle, x0, x1, y);
  }

  // Draws the pixels x0 to x1 of row y of the tile.
  void draw_row(const HomogeneousTriangle& triangle, int x0, int x1, int y) {
    constexpr int kMaxPixels = HomogeneousTriangle::kMaxPixels;
    for (int x = x0; x <= x1; x += kMaxPixels) {
      const auto n = static_cast<std::size_t>(std::min(kMaxPixels, x1 + 1 - x));
      const std::size_t at =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(view_.width) + static_cast<std::size_t>(x);
      float sx[kMaxPixels], sy[kMaxPixels];
      if (!view_.sample_x)
        for (std::size_t i = 0; i < n; ++i) {
          sx[i] = static_cast<float>(x + static_cast<int>(i));
          sy[i] = static_cast<float>(y);
        }
      HWY_DYNAMIC_DISPATCH(DrawHomogeneous)
      (triangle, view_.sample_x ? view_.sample_x + at : sx, view_.sample_y ? view_.sample_y + at : sy, n,
       out_.nearness.data() + at, out_.triangle.data() + at);
    }
  }

  // Projects the vertex in row r and column c of the block in float, by the operations of project_row.
  Corner corner(int r, int c) const {
    const std::size_t at =
        static_cast<std::size_t>(r) * static_cast<std::size_t>(block_.stride) + static_cast<std::size_t>(c);
    const float p[3] = {block_.x[at] - view_.pivot[0], block_.y[at] - view_.pivot[1], block_.z[at] - view_.pivot[2]};
    Corner out = view_.motion ? moving_corner(p, *view_.motion) : still_corner(p);
    out.in_guard_band = engine::in_guard_band(static_cast<float>(out.z), out.px, out.py, view_.min_depth_m);
    const double aside = static_cast<double>(view_.slack[0]);
    const double above = static_cast<double>(view_.slack[1]);
    const bool outside[]{out.z <= 0, out.x<-(1 + aside) * out.z, out.x>(view_.width + aside) * out.z,
                         out.y<-(1 + above) * out.z, out.y>(view_.height + above) * out.z};
    for (unsigned k = 0; k < std::size(outside); ++k) out.outside |= unsigned{outside[k]} << k;
    return out;
  }

  // Projects a point relative to the pivot, by the operations of project_row.
  Corner still_corner(const float* p) const {
    const auto dot = [&](int k) {
      return (view_.row[k][0] * p[0] + (view_.row[k][1] * p[1] + view_.row[k][2] * p[2])) + view_.offset[k];
    };
    Corner out{};
    const float h[3] = {dot(0), dot(1), dot(2)};
    const float inverse = 1 / h[2];
    out.x = static_cast<double>(h[0]);
    out.y = static_cast<double>(h[1]);
    out.z = static_cast<double>(h[2]);
    out.px = h[0] * inverse;
    out.py = h[1] * inverse;
    return out;
  }

  // Projects a point relative to the pivot, by the operations of project_moving_row.
  static Corner moving_corner(const float* p, const RowMotion& motion) {
    const auto dot = [&](const float* form) { return form[0] * p[0] + (form[1] * p[1] + form[2] * p[2]); };
    const auto form = [&](const float* f) { return dot(f) + f[3]; };
    const auto polynomial = [](float p0, float p1, float p2, float r) { return p0 + r * (p1 + r * p2); };
    const auto within_reach = [&](float r) {
      const float above_end = r > -motion.reach ? r : -motion.reach;  // as vectors treat NaN
      return above_end < motion.reach ? above_end : motion.reach;
    };
    const float f0 = form(motion.off_row[0]), f1 = form(motion.off_row[1]), f2 = form(motion.off_row[2]);
    const float d0 = dot(motion.depth[0]), d1 = dot(motion.depth[1]), d2 = dot(motion.depth[2]);
    const float f3 = -(d2 + motion.depth[2][3]);
    const auto off_row = [&](float r) { return f0 + r * polynomial(f1, f2, f3, r); };
    float r = within_reach(-(f0 / f1));
    const float slope = polynomial(f1, f2 + f2, 3.F * f3, r);
    r = within_reach(r - off_row(r) / slope);
    const float beyond_pivot = polynomial(d0, d1, d2, r);
    const float depth = beyond_pivot + polynomial(motion.depth[0][3], motion.depth[1][3], motion.depth[2][3], r);
    const float column = polynomial(form(motion.column[0]), form(motion.column[1]), form(motion.column[2]), r);
    const float inverse = 1 / depth, off = off_row(r), row = r + motion.middle;
    Corner out{};
    out.x = static_cast<double>(column);
    out.y = static_cast<double>(row) * static_cast<double>(depth) + static_cast<double>(off);
    out.z = static_cast<double>(depth);
    out.px = column * inverse;
    out.py = row + off * inverse;
    return out;
  }

  // Returns the edge function through two corners: the cross product of their homogeneous coordinates. It is 0 at the
  // pixels of the line through both.
  static Plane plane(const Corner& p, const Corner& q) {
    return {p.y * q.z - p.z * q.y, p.z * q.x - p.x * q.z, p.x * q.y - p.y * q.x};
  }

  static Edge edge(const Corner& p, const Corner& q, bool flip) {
    Edge e{};
    e.in_guard_band = p.in_guard_band && q.in_guard_band;
    e.flip = flip;
    e.ox = p.px;
    e.oy = p.py;
    e.ex = q.px - p.px;
    e.ey = q.py - p.py;
    e.plane = plane(p, q);
    return e;
  }

  const RasterBlock& block_;
  const TileView& view_;
  TileBuffer& out_;
  std::array<Corner, 65> south_, north_;  // rows of corners; TriangleId has at most 64 quads per row
};

}  // namespace

void draw_strip(const RasterBlock& block, const Strip& strip, const TileView& view, bool leaves_guard_band,
                TileBuffer& out) {
  if (!leaves_guard_band) {
    HWY_DYNAMIC_DISPATCH(DrawStrip)(block, strip, view, out);
    return;
  }
  HomogeneousDrawer(block, view, out).draw_all(strip);
}

void cast_strip(const RasterBlock& block, const Strip& strip, const LightAxes& axes, LightBand& band) {
  HWY_DYNAMIC_DISPATCH(CastStrip)(block, strip, axes, band);
}

std::size_t bound_occluders(const RasterBlock& block, const Strip& strip, const LightAxes& axes, LightBox* boxes) {
  return HWY_DYNAMIC_DISPATCH(BoundOccluders)(block, strip, axes, boxes);
}

void range_of(const float* x, std::size_t n, float& low, float& high) {
  HWY_DYNAMIC_DISPATCH(RangeOf)(x, n, low, high);
}

void update_coarse_min(LightBand& band, int c0, int c1, int r0, int r1) {
  HWY_DYNAMIC_DISPATCH(UpdateCoarseMin)(band, c0, c1, r0, r1);
}

void cast_skirt(const Skirt& skirt, const LightAxes& axes, LightBand& band) {
  HWY_DYNAMIC_DISPATCH(CastSkirt)(skirt, axes, band);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
