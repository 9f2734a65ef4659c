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
// Triangles too large, too near or partly behind the eye for pixels in float: homogeneous edges in double (Olano and
// Greer, Triangle scan conversion using 2D homogeneous coordinates, 1997), without any clipping. An edge between two
// vertices inside the guard band is tested in float as whole strips test it, so that both meet bit for bit.
struct HomogeneousTriangle {
  // e(x, y) = x . x + y . y + one
  struct Plane {
    double x, y, one;
  };
  struct Edge {
    bool in_guard_band;  // both ends
    bool flip;           // inside is where it is negative
    float ox, oy, ex, ey;
    Plane plane;
  };
  static constexpr int kMostPixels = 128;
  Edge edges[3];
  Plane inverse;                // 1 / depth
  double near0, near1, offset;  // nearness from it
  std::uint32_t name;
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

constexpr F f;
constexpr I i32;
constexpr int kMostColumns = 96;  // of a row of vertices, padding included

HWY_INLINE VF all(float x) { return hn::Set(f, x); }

// Three edges of a triangle, each from an end of its own, turned so that inside is where all are positive or zero; and
// a plane over them.
struct Triangles {
  // Written here so that it's compiled for the target, as the compiler's own wouldn't be.
  HWY_INLINE Triangles() {}  // NOLINT(modernize-use-equals-default)
  VF ox[3], oy[3], ex[3], ey[3];
  VF px, py, p, gx, gy;  // value p at (px, py), and its gradient
};

// Corners a, b, c of the quad's lower half (south-west, south-east, north-west) or, for the upper half, north-east d in
// place of a: edges run eastward, northward and along the diagonal from b to c, in either.
// Twice a triangle's area, positive if its corners (the upper half's d, c, b) are counter-clockwise.
HWY_INLINE VF area_of(bool upper, VF ax, VF ay, VF bx, VF by, VF cx, VF cy) {
  const VF x0 = upper ? hn::Sub(ax, cx) : hn::Sub(bx, ax), y0 = upper ? hn::Sub(ay, cy) : hn::Sub(by, ay);
  const VF x1 = upper ? hn::Sub(ax, bx) : hn::Sub(cx, ax), y1 = upper ? hn::Sub(ay, by) : hn::Sub(cy, ay);
  return hn::Sub(hn::Mul(x0, y1), hn::Mul(y0, x1));
}

HWY_INLINE Triangles set_up(bool upper, VF ax, VF ay, VF a, VF bx, VF by, VF b, VF cx, VF cy, VF c, VF& area) {
  Triangles t;
  // lower: a -> b, a -> c, b -> c; upper: c -> a, b -> a, b -> c.
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
  area = area_of(upper, ax, ay, bx, by, cx, cy);
  // Differences from the corner where the first two edges meet.
  const VF d1 = upper ? hn::Sub(c, a) : hn::Sub(b, a), d2 = upper ? hn::Sub(b, a) : hn::Sub(c, a);
  const VF x1 = upper ? hn::Neg(t.ex[0]) : t.ex[0], y1 = upper ? hn::Neg(t.ey[0]) : t.ey[0];
  const VF x2 = upper ? hn::Neg(t.ex[1]) : t.ex[1], y2 = upper ? hn::Neg(t.ey[1]) : t.ey[1];
  const VF scale = hn::Div(all(1.F), area);
  t.gx = hn::Mul(hn::Sub(hn::Mul(d1, y2), hn::Mul(d2, y1)), scale);
  t.gy = hn::Mul(hn::Sub(hn::Mul(d2, x1), hn::Mul(d1, x2)), scale);
  t.px = ax;
  t.py = ay;
  t.p = a;
  // Which side is inside, seen from outside counter-clockwise: left of the first edge of the lower half, right of the
  // second, left of the third; the other way round for the upper one.
  return t;
}

// Turns the edges: `positive` where the triangle's area is.
HWY_INLINE void turn(Triangles& t, bool upper, MF positive) {
  const MF flip_first = upper ? positive : hn::Not(positive), flip_second = upper ? hn::Not(positive) : positive;
  t.ex[0] = hn::IfThenElse(flip_first, hn::Neg(t.ex[0]), t.ex[0]);
  t.ey[0] = hn::IfThenElse(flip_first, hn::Neg(t.ey[0]), t.ey[0]);
  t.ex[1] = hn::IfThenElse(flip_second, hn::Neg(t.ex[1]), t.ex[1]);
  t.ey[1] = hn::IfThenElse(flip_second, hn::Neg(t.ey[1]), t.ey[1]);
  t.ex[2] = hn::IfThenElse(flip_first, hn::Neg(t.ex[2]), t.ex[2]);
  t.ey[2] = hn::IfThenElse(flip_first, hn::Neg(t.ey[2]), t.ey[2]);
}

HWY_INLINE MF inside(const Triangles& t, VF x, VF y) {
  const auto edge = [&](int k) {
    return hn::Ge(hn::Sub(hn::Mul(t.ex[k], hn::Sub(y, t.oy[k])), hn::Mul(t.ey[k], hn::Sub(x, t.ox[k]))), hn::Zero(f));
  };
  return hn::And(edge(0), hn::And(edge(1), edge(2)));
}

HWY_INLINE VF value(const Triangles& t, VF x, VF y) {
  return hn::Add(t.p, hn::Add(hn::Mul(t.gx, hn::Sub(x, t.px)), hn::Mul(t.gy, hn::Sub(y, t.py))));
}

// A vector of triangles, and one of them, broadcast: its plane is fetched where it is needed.
HWY_INLINE void store(const Triangles& t, float* out, std::size_t lanes) {
  for (int k = 0; k < 3; ++k) {
    hn::StoreU(t.ox[k], f, out + (4 * k + 0) * lanes);
    hn::StoreU(t.oy[k], f, out + (4 * k + 1) * lanes);
    hn::StoreU(t.ex[k], f, out + (4 * k + 2) * lanes);
    hn::StoreU(t.ey[k], f, out + (4 * k + 3) * lanes);
  }
  hn::StoreU(t.px, f, out + 12 * lanes);
  hn::StoreU(t.py, f, out + 13 * lanes);
  hn::StoreU(t.p, f, out + 14 * lanes);
  hn::StoreU(t.gx, f, out + 15 * lanes);
  hn::StoreU(t.gy, f, out + 16 * lanes);
}
struct Stored {
  const float* in;
  std::size_t lanes, lane;
  HWY_INLINE VF at(int k) const { return all(in[static_cast<std::size_t>(k) * lanes + lane]); }
  HWY_INLINE void edges(Triangles& t) const {
    for (int k = 0; k < 3; ++k) {
      t.ox[k] = at(4 * k);
      t.oy[k] = at(4 * k + 1);
      t.ex[k] = at(4 * k + 2);
      t.ey[k] = at(4 * k + 3);
    }
  }
  HWY_INLINE void plane(Triangles& t) const {
    t.px = at(12);
    t.py = at(13);
    t.p = at(14);
    t.gx = at(15);
    t.gy = at(16);
  }
};

// ---- the view ------------------------------------------------------------------------------------------------------

struct Projected {
  alignas(64) float x[kMostColumns], y[kMostColumns], w[kMostColumns];  // pixels, pixels, nearness
};

HWY_INLINE void project_row(const RasterBlock& b, int row, const TileView& view, Projected& out) {
  const std::size_t first = static_cast<std::size_t>(row) * static_cast<std::size_t>(b.stride);
  const auto dot = [&](int k, VF x, VF y, VF z) {
    return hn::Add(hn::Mul(all(view.row[k][0]), x),
                   hn::Add(hn::Mul(all(view.row[k][1]), y), hn::Mul(all(view.row[k][2]), z)));
  };
  const VF near0 = all(view.near0), near1 = all(view.near1);
  for (int c = 0; c < b.stride; c += static_cast<int>(hn::Lanes(f))) {
    const std::size_t at = first + static_cast<std::size_t>(c);
    const VF x = hn::Sub(hn::LoadU(f, b.x + at), all(view.pivot[0])),
             y = hn::Sub(hn::LoadU(f, b.y + at), all(view.pivot[1])),
             z = hn::Sub(hn::LoadU(f, b.z + at), all(view.pivot[2]));
    const VF along = dot(2, x, y, z), inverse = hn::Div(all(1.F), hn::Add(along, all(view.offset[2])));
    hn::Store(hn::Mul(hn::Add(dot(0, x, y, z), all(view.offset[0])), inverse), f, out.x + c);
    hn::Store(hn::Mul(hn::Add(dot(1, x, y, z), all(view.offset[1])), inverse), f, out.y + c);
    hn::Store(hn::Mul(hn::Sub(near0, hn::Mul(near1, along)), inverse), f, out.w + c);
  }
}

// Of equally near triangles the first wins, whichever is drawn first, so that it is the same at every width: by block,
// row, group of sixteen quads, half, and place in the group. Of TriangleId::packed(), that is to turn the last five
// bits by one.
HWY_INLINE bool precedes(std::uint32_t id, std::uint32_t drawn) {
  const auto key = [](std::uint32_t of) { return (of & ~31U) | (of & 1) << 4 | (of >> 1 & 15); };
  return key(id) < key(drawn);
}
HWY_INLINE MF precede(VI id, VI drawn) {
  // Unsigned, by signed comparison.
  const auto key = [](VI of) {
    const VI place = hn::And(hn::ShiftRight<1>(of), hn::Set(i32, 15)),
             half = hn::ShiftLeft<4>(hn::And(of, hn::Set(i32, 1)));
    const VI rest = hn::AndNot(hn::Set(i32, 31), of);
    return hn::Xor(hn::Or(rest, hn::Or(half, place)), hn::Set(i32, std::numeric_limits<std::int32_t>::min()));
  };
  return hn::RebindMask(f, hn::Lt(key(id), key(drawn)));
}

// A large triangle: its box row by row.
HWY_NOINLINE void fill(const Stored& one, int x0, int x1, int y0, int y1, std::uint32_t id, const TileView& view,
                       TileBuffer& out) {
  Triangles t;
  one.edges(t);
  one.plane(t);
  const int width = view.width;
  const int lanes = static_cast<int>(hn::Lanes(f));
  const VF ramp = hn::Iota(f, 0.F);
  const VI name = hn::Set(i32, static_cast<std::int32_t>(id));
  for (int y = y0; y <= y1; ++y) {
    const VF py = all(static_cast<float>(y));
    for (int x = x0; x <= x1; x += lanes) {
      const VF px = hn::Add(all(static_cast<float>(x)), ramp);
      const std::size_t at =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
      const VF vx = view.sample_x ? hn::LoadU(f, view.sample_x + at) : px,
               vy = view.sample_y ? hn::LoadU(f, view.sample_y + at) : py;
      MF m = hn::And(inside(t, vx, vy), hn::Le(px, all(static_cast<float>(x1))));
      if (hn::AllFalse(f, m)) continue;
      float* depth = out.nearness.data() + at;
      auto* ids = reinterpret_cast<std::int32_t*>(out.triangle.data() + (depth - out.nearness.data()));
      const VF w = value(t, vx, vy), old = hn::LoadU(f, depth);
      const MF equal = hn::And(m, hn::Eq(w, old));
      m = hn::And(m, hn::Gt(w, old));
      if (HWY_UNLIKELY(!hn::AllFalse(f, equal))) m = hn::Or(m, hn::And(equal, precede(name, hn::LoadU(i32, ids))));
      hn::BlendedStore(w, m, f, depth);
      hn::BlendedStore(name, hn::RebindMask(i32, m), i32, ids);
    }
  }
}

// Sixteen small triangles at once, each walking through its own box.
template <bool kSamples>
HWY_INLINE void walk(const Triangles& t, MF active, VF x0, VF x1, VF y0, VF y1, VI ids, const TileView& view,
                     TileBuffer& out) {
  VF x = x0, y = y0;
  alignas(64) std::int32_t at[16] = {};
  alignas(64) std::int32_t id[16] = {};
  alignas(64) float w[16] = {};
  const VF one = all(1.F), columns = all(static_cast<float>(view.width));
  while (!hn::AllFalse(f, active)) {
    const auto place = [&] { return hn::ConvertTo(i32, hn::IfThenElseZero(active, hn::Add(hn::Mul(y, columns), x))); };
    VF sx = x, sy = y;
    if constexpr (kSamples) {
      const VI at_sample = place();
      sx = hn::GatherIndex(f, view.sample_x, at_sample);
      sy = hn::GatherIndex(f, view.sample_y, at_sample);
    }
    const MF hit = hn::And(active, inside(t, sx, sy));
    if (!hn::AllFalse(f, hit)) {
      const ToFront to_front(hit);
      hn::Store(to_front(place()), i32, at);
      hn::Store(to_front(ids), i32, id);
      hn::Store(to_front(value(t, sx, sy)), f, w);
      const std::size_t n = hn::CountTrue(f, hit);
      for (std::size_t k = 0; k < n; ++k) {
        const auto p = static_cast<std::size_t>(at[k]);
        const auto name = static_cast<std::uint32_t>(id[k]);
        if (w[k] > out.nearness[p]) {
          out.nearness[p] = w[k];
          out.triangle[p] = name;
        } else if (HWY_UNLIKELY(w[k] == out.nearness[p]) && precedes(name, out.triangle[p]))
          out.triangle[p] = name;
      }
    }
    x = hn::Add(x, one);
    const MF next = hn::Gt(x, x1);
    x = hn::IfThenElse(next, x0, x);
    y = hn::IfThenElse(next, hn::Add(y, one), y);
    active = hn::And(active, hn::Le(y, y1));
  }
}

constexpr float kSmall = 24;  // pixels of a box that is walked through

template <bool upper>
HWY_NOINLINE void draw(const VF* x, const VF* y, const VF* w, VI ids, MF valid, const TileView& view, TileBuffer& out) {
  // x[0]: a or d; 1: b; 2: c
  const VF right = all(static_cast<float>(view.width - 1)), bottom = all(static_cast<float>(view.height - 1));
  const VF aside = all(view.slack[0]), above = all(view.slack[1]);
  const VF x0 = hn::Max(hn::Ceil(hn::Sub(hn::Min(x[0], hn::Min(x[1], x[2])), aside)), hn::Zero(f)),
           x1 = hn::Min(hn::Floor(hn::Add(hn::Max(x[0], hn::Max(x[1], x[2])), aside)), right),
           y0 = hn::Max(hn::Ceil(hn::Sub(hn::Min(y[0], hn::Min(y[1], y[2])), above)), hn::Zero(f)),
           y1 = hn::Min(hn::Floor(hn::Add(hn::Max(y[0], hn::Max(y[1], y[2])), above)), bottom);
  MF active = hn::And(valid, hn::And(hn::Le(x0, x1), hn::Le(y0, y1)));
  if (hn::AllFalse(f, active)) return;
  VF area;
  Triangles t = set_up(upper, x[0], y[0], w[0], x[1], y[1], w[1], x[2], y[2], w[2], area);
  active = hn::And(active, hn::Ne(area, hn::Zero(f)));
  // Pixels' rows run down, so what is counter-clockwise from outside is clockwise here; `turn` asks for the sign alone.
  turn(t, upper, hn::Gt(area, hn::Zero(f)));
  const VF pixels = hn::Mul(hn::Add(hn::Sub(x1, x0), all(1.F)), hn::Add(hn::Sub(y1, y0), all(1.F)));
  const MF large = hn::And(active, hn::Gt(pixels, all(kSmall)));
  if (!hn::AllFalse(f, large)) {
    const std::size_t lanes = hn::Lanes(f);
    alignas(64) float stored[17 * 16];
    alignas(64) float box[4][16];
    alignas(64) std::int32_t id[16];
    alignas(64) std::int32_t mask[16];
    store(t, stored, lanes);
    hn::Store(x0, f, box[0]);
    hn::Store(x1, f, box[1]);
    hn::Store(y0, f, box[2]);
    hn::Store(y1, f, box[3]);
    hn::Store(ids, i32, id);
    hn::Store(hn::IfThenElse(hn::RebindMask(i32, large), hn::Set(i32, 1), hn::Zero(i32)), i32, mask);
    for (std::size_t k = 0; k < lanes; ++k)
      if (mask[k])
        fill({stored, lanes, k}, static_cast<int>(box[0][k]), static_cast<int>(box[1][k]), static_cast<int>(box[2][k]),
             static_cast<int>(box[3][k]), static_cast<std::uint32_t>(id[k]), view, out);
    active = hn::AndNot(large, active);
  }
  if (view.sample_x)
    walk<true>(t, active, x0, x1, y0, y1, ids, view, out);
  else
    walk<false>(t, active, x0, x1, y0, y1, ids, view, out);
}

HWY_INLINE MF number(VF x) { return hn::Eq(x, x); }

// Triangles that wait until there is a vector of them: of most vectors few lanes have anything to draw or to cast.
class Waiting {
 public:
  // Three corners, three values of each.
  struct Corners {
    HWY_INLINE Corners() {}  // NOLINT(modernize-use-equals-default): as Triangles'
    VF x[3], y[3], w[3];
    VI name;
  };

  // For each vector that is full: work(corners, mask of all lanes).
  template <typename Work>
  HWY_INLINE void add(const Corners& more, MF mask, const Work& work) {
    const std::size_t lanes = hn::Lanes(f);
    if (hn::AllTrue(f, mask)) return work(more, mask);
    const ToFront to_front(mask);
    const auto append = [&](int k, VF values) { hn::StoreU(to_front(values), f, values_[k] + count_); };
    for (int k = 0; k < 3; ++k) {
      append(k, more.x[k]);
      append(3 + k, more.y[k]);
      append(6 + k, more.w[k]);
    }
    hn::StoreU(to_front(more.name), i32, names_ + count_);
    count_ += hn::CountTrue(f, mask);
    if (count_ < lanes) return;
    work(corners(), hn::Eq(hn::Zero(f), hn::Zero(f)));
    count_ -= lanes;
    for (float* values : values_) hn::Store(hn::Load(f, values + lanes), f, values);
    hn::Store(hn::Load(i32, names_ + lanes), i32, names_);
  }
  // For those that are left.
  template <typename Work>
  HWY_INLINE void finish(const Work& work) {
    if (count_ > 0) work(corners(), hn::FirstN(f, count_));
    count_ = 0;
  }

 private:
  HWY_INLINE Corners corners() const {
    Corners out;
    for (int k = 0; k < 3; ++k) {
      out.x[k] = hn::Load(f, values_[k]);
      out.y[k] = hn::Load(f, values_[3 + k]);
      out.w[k] = hn::Load(f, values_[6 + k]);
    }
    out.name = hn::Load(i32, names_);
    return out;
  }

  alignas(64) float values_[9][32] = {};
  alignas(64) std::int32_t names_[32] = {};
  std::size_t count_ = 0;
};

// A vector of quads: corners a (south-west), b (south-east), c (north-west), d (north-east).
struct Quads {
  HWY_INLINE Quads() {}  // NOLINT(modernize-use-equals-default): as Triangles'
  VF x[4], y[4], w[4];   // pixels, pixels, nearness
  MF lower, upper;       // whether their triangles have all vertices, and some pixel may be on them
};

// From column c on. Whether any of them may have a pixel of the tile.
HWY_INLINE bool load(const Projected& south, const Projected& north, int c, const TileView& view, Quads& q) {
  const auto corners = [&](const float* a, const float* b, VF* out) {
    out[0] = hn::Load(f, a + c);
    out[1] = hn::LoadU(f, a + c + 1);
    out[2] = hn::Load(f, b + c);
    out[3] = hn::LoadU(f, b + c + 1);
  };
  corners(south.x, north.x, q.x);
  corners(south.y, north.y, q.y);
  const MF diagonal = hn::And(number(q.x[1]), number(q.x[2]));
  q.lower = hn::And(diagonal, number(q.x[0]));
  q.upper = hn::And(diagonal, number(q.x[3]));
  // As `draw` has the boxes.
  const auto some = [&](const VF* v, float slack, int last, MF& lower, MF& upper) {
    const VF aside = all(slack), end = all(static_cast<float>(last)), least = hn::Min(v[1], v[2]),
             most = hn::Max(v[1], v[2]);
    const auto within = [&](VF corner) {
      const VF low = hn::Max(hn::Ceil(hn::Sub(hn::Min(corner, least), aside)), hn::Zero(f)),
               high = hn::Min(hn::Floor(hn::Add(hn::Max(corner, most), aside)), end);
      return hn::Le(low, high);
    };
    lower = hn::And(lower, within(v[0]));
    upper = hn::And(upper, within(v[3]));
  };
  some(q.x, view.slack[0], view.width - 1, q.lower, q.upper);
  some(q.y, view.slack[1], view.height - 1, q.lower, q.upper);
  if (hn::AllFalse(f, hn::Or(q.lower, q.upper))) return false;
  corners(south.w, north.w, q.w);
  return true;
}

void DrawStrip(const RasterBlock& b, const Strip& strip, const TileView& view, TileBuffer& out) {
  Projected rows[2];
  Waiting lower, upper;
  const int lanes = static_cast<int>(hn::Lanes(f));
  const auto draw_lower = [&](const Waiting::Corners& t, MF valid)
                              HWY_ATTR { draw<false>(t.x, t.y, t.w, t.name, valid, view, out); };
  const auto draw_upper = [&](const Waiting::Corners& t, MF valid)
                              HWY_ATTR { draw<true>(t.x, t.y, t.w, t.name, valid, view, out); };
  project_row(b, strip.first_row, view, rows[0]);
  for (int r = strip.first_row; r < strip.first_row + strip.rows; ++r) {
    const Projected &south = rows[(r - strip.first_row) & 1], &north = rows[(r + 1 - strip.first_row) & 1];
    project_row(b, r + 1, view, rows[(r + 1 - strip.first_row) & 1]);
    for (int c = 0; c < b.quads; c += lanes) {
      Quads q;
      if (!load(south, north, c, view, q)) continue;
      for (int i = 0; i < lanes; i += 4) __builtin_prefetch(b.vertices + (r + 1) * (b.quads + 1) + c + i, 0, 3);
      Waiting::Corners t;
      t.name = hn::Add(hn::Set(i32, static_cast<std::int32_t>(TriangleId(strip.block, r, c, false).packed())),
                       hn::ShiftLeft<1>(hn::Iota(i32, 0)));
      for (int k = 0; k < 3; ++k) {
        t.x[k] = q.x[k];
        t.y[k] = q.y[k];
        t.w[k] = q.w[k];
      }
      if (!hn::AllFalse(f, q.lower)) lower.add(t, q.lower, draw_lower);
      if (hn::AllFalse(f, q.upper)) continue;
      t.x[0] = q.x[3];
      t.y[0] = q.y[3];
      t.w[0] = q.w[3];
      t.name = hn::Add(t.name, hn::Set(i32, 1));
      upper.add(t, q.upper, draw_upper);
    }
  }
  lower.finish(draw_lower);
  upper.finish(draw_upper);
}

// ---- the Sun -------------------------------------------------------------------------------------------------------

struct Lighted {
  alignas(64) float u[kMostColumns];
  alignas(64) float v[kMostColumns];
  alignas(64) float d[kMostColumns];
};

HWY_INLINE void light_row(const RasterBlock& b, int row, const LightAxes& axes, Lighted& out) {
  const std::size_t first = static_cast<std::size_t>(row) * static_cast<std::size_t>(b.stride);
  for (int c = 0; c < b.stride; c += static_cast<int>(hn::Lanes(f))) {
    const std::size_t at = first + static_cast<std::size_t>(c);
    const VF x = hn::LoadU(f, b.x + at), y = hn::LoadU(f, b.y + at), z = hn::LoadU(f, b.z + at);
    const auto dot = [&](const float* a) {
      return hn::Add(hn::Mul(all(a[0]), x), hn::Add(hn::Mul(all(a[1]), y), hn::Mul(all(a[2]), z)));
    };
    hn::Store(dot(axes.u), f, out.u + c);
    hn::Store(dot(axes.v), f, out.v + c);
    hn::Store(dot(axes.d), f, out.d + c);
  }
}

HWY_INLINE VI cells(VF x, float first, float per_metre, int last) {
  const VF at = hn::Floor(hn::Mul(hn::Sub(x, all(first)), all(per_metre)));
  return hn::ConvertTo(i32, hn::Min(hn::Max(at, hn::Zero(f)), all(static_cast<float>(last))));
}

// The samples under one triangle.
HWY_INLINE void shade(const Stored& one, int c0, int c1, int r0, int r1, LightBand& band) {
  Triangles t;
  one.edges(t);
  const std::size_t lanes = hn::Lanes(f);
  const VF dark = all(std::numeric_limits<float>::infinity());
  for (int r = r0; r <= r1; ++r) {
    const std::size_t row = static_cast<std::size_t>(r) * static_cast<std::size_t>(band.columns);
    const std::size_t first = band.start[row + static_cast<std::size_t>(c0)];
    const std::size_t past_last = band.start[row + static_cast<std::size_t>(c1) + 1];
    for (std::size_t k = first; k < past_last; k += lanes) {
      const VF u = hn::LoadU(f, band.u.data() + k), v = hn::LoadU(f, band.v.data() + k);
      MF m = inside(t, u, v);
      if (hn::AllFalse(f, m)) continue;  // nine of ten, where triangles are smaller than pixels
      one.plane(t);
      m = hn::And(m, hn::Gt(value(t, u, v), hn::LoadU(f, band.d.data() + k)));
      hn::BlendedStore(dark, m, f, band.d.data() + k);
    }
  }
}

// Triangles that face away from the Sun: their area is negative.
HWY_INLINE MF faces_away(const VF* u, const VF* v, bool upper, MF valid) {
  return hn::And(valid, hn::Lt(area_of(upper, u[0], v[0], u[1], v[1], u[2], v[2]), hn::Zero(f)));
}

// Triangles that face away from the Sun and may have samples of the band below them.
HWY_INLINE MF casting(const VF* u, const VF* v, bool upper, MF valid, const LightBand& band) {
  const auto within = [](const VF* at, float first, float last) {
    return hn::And(hn::Ge(hn::Max(at[0], hn::Max(at[1], at[2])), all(first)),
                   hn::Le(hn::Min(at[0], hn::Min(at[1], at[2])), all(last)));
  };
  return hn::And(faces_away(u, v, upper, valid),
                 hn::And(within(v, band.v0 - band.margin_m, band.v_end() + band.margin_m),
                         within(u, band.u0 - band.margin_m, band.u_end() + band.margin_m)));
}

// Casts a vector of those.
template <bool upper>
HWY_NOINLINE void cast(const VF* u, const VF* v, const VF* d, MF active, LightBand& band) {
  const VF u_low = hn::Min(u[0], hn::Min(u[1], u[2])), u_high = hn::Max(u[0], hn::Max(u[1], u[2])),
           v_low = hn::Min(v[0], hn::Min(v[1], v[2])), v_high = hn::Max(v[0], hn::Max(v[1], v[2]));
  VF area;
  Triangles t = set_up(upper, u[0], v[0], d[0], u[1], v[1], d[1], u[2], v[2], d[2], area);
  turn(t, upper, hn::Gt(area, hn::Zero(f)));
  const std::size_t lanes = hn::Lanes(f);
  alignas(64) std::int32_t c0[16];
  alignas(64) std::int32_t c1[16];
  alignas(64) std::int32_t r0[16];
  alignas(64) std::int32_t r1[16];
  alignas(64) std::int32_t mask[16];
  alignas(64) float stored[17 * 16];
  alignas(64) float highest[16];
  hn::Store(cells(u_low, band.u0, band.per_u, band.columns - 1), i32, c0);
  hn::Store(cells(u_high, band.u0, band.per_u, band.columns - 1), i32, c1);
  hn::Store(cells(v_low, band.v0, band.per_v, band.rows - 1), i32, r0);
  hn::Store(cells(v_high, band.v0, band.per_v, band.rows - 1), i32, r1);
  hn::Store(hn::IfThenElse(hn::RebindMask(i32, active), hn::Set(i32, 1), hn::Zero(i32)), i32, mask);
  hn::Store(hn::Max(d[0], hn::Max(d[1], d[2])), f, highest);
  store(t, stored, lanes);
  for (std::size_t k = 0; k < lanes; ++k) {
    if (!mask[k]) continue;
    if (band.any_below(c0[k], c1[k], r0[k], r1[k], highest[k]))
      shade({stored, lanes, k}, c0[k], c1[k], r0[k], r1[k], band);
  }
}

void CastStrip(const RasterBlock& b, const Strip& strip, const LightAxes& axes, LightBand& band) {
  Lighted rows[2];
  Waiting lower, upper;
  const int lanes = static_cast<int>(hn::Lanes(f));
  const auto cast_lower = [&](const Waiting::Corners& t, MF active)
                              HWY_ATTR { cast<false>(t.x, t.y, t.w, active, band); };
  const auto cast_upper = [&](const Waiting::Corners& t, MF active)
                              HWY_ATTR { cast<true>(t.x, t.y, t.w, active, band); };
  light_row(b, strip.first_row, axes, rows[0]);
  for (int r = strip.first_row; r < strip.first_row + strip.rows; ++r) {
    const Lighted &south = rows[(r - strip.first_row) & 1], &north = rows[(r + 1 - strip.first_row) & 1];
    light_row(b, r + 1, axes, rows[(r + 1 - strip.first_row) & 1]);
    for (int c = 0; c < b.quads; c += lanes) {
      Waiting::Corners t;
      t.name = hn::Zero(i32);
      const auto corners = [&](const float* s, const float* n, VF* at) HWY_ATTR {
        at[0] = hn::Load(f, s + c);
        at[1] = hn::LoadU(f, s + c + 1);
        at[2] = hn::Load(f, n + c);
      };
      corners(south.u, north.u, t.x);
      corners(south.v, north.v, t.y);
      const MF diagonal = hn::And(number(t.x[1]), number(t.x[2]));
      const MF low = casting(t.x, t.y, false, hn::And(diagonal, number(t.x[0])), band);
      const VF south_west_u = t.x[0], south_west_v = t.y[0];
      t.x[0] = hn::LoadU(f, north.u + c + 1);
      t.y[0] = hn::LoadU(f, north.v + c + 1);
      const MF up = casting(t.x, t.y, true, hn::And(diagonal, number(t.x[0])), band);
      if (hn::AllFalse(f, hn::Or(low, up))) continue;
      corners(south.d, north.d, t.w);
      const VF south_west_d = t.w[0];
      t.w[0] = hn::LoadU(f, north.d + c + 1);
      if (!hn::AllFalse(f, up)) upper.add(t, up, cast_upper);
      if (hn::AllFalse(f, low)) continue;
      t.x[0] = south_west_u;
      t.y[0] = south_west_v;
      t.w[0] = south_west_d;
      lower.add(t, low, cast_lower);
    }
  }
  lower.finish(cast_lower);
  upper.finish(cast_upper);
}

// Bounds of the triangles that face away from the Sun, per column of quads.
struct ColumnBounds {
  alignas(64) float u_low[kMostColumns];
  alignas(64) float u_high[kMostColumns];
  alignas(64) float v_low[kMostColumns];
  alignas(64) float v_high[kMostColumns];
  alignas(64) float d_high[kMostColumns];

  ColumnBounds() {
    constexpr float kInfinite = std::numeric_limits<float>::infinity();
    for (float* low : {u_low, v_low}) std::fill_n(low, kMostColumns, kInfinite);
    for (float* high : {u_high, v_high, d_high}) std::fill_n(high, kMostColumns, -kInfinite);
  }
  // d_high is -infinity if there are none.
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

// From column c on.
HWY_INLINE void extend(const Lighted& south, const Lighted& north, int c, ColumnBounds& bounds) {
  const auto corners = [&](const float* s, const float* n, VF* at) HWY_ATTR {
    at[0] = hn::Load(f, s + c);
    at[1] = hn::LoadU(f, s + c + 1);
    at[2] = hn::Load(f, n + c);
    at[3] = hn::LoadU(f, n + c + 1);
  };
  VF u[4], v[4], d[4];
  corners(south.u, north.u, u);
  corners(south.v, north.v, v);
  const MF diagonal = hn::And(number(u[1]), number(u[2]));
  const VF upper_u[3] = {u[3], u[1], u[2]}, upper_v[3] = {v[3], v[1], v[2]};
  const MF low = faces_away(u, v, false, hn::And(diagonal, number(u[0]))),
           up = faces_away(upper_u, upper_v, true, hn::And(diagonal, number(u[3])));
  if (hn::AllFalse(f, hn::Or(low, up))) return;
  corners(south.d, north.d, d);
  const auto extend_low = [&](const VF* x, float* out) HWY_ATTR {
    const VF shared = hn::Min(x[1], x[2]), of_none = all(std::numeric_limits<float>::infinity());
    const VF lower = hn::IfThenElse(low, hn::Min(x[0], shared), of_none),
             upper = hn::IfThenElse(up, hn::Min(x[3], shared), of_none);
    hn::Store(hn::Min(hn::Load(f, out + c), hn::Min(lower, upper)), f, out + c);
  };
  const auto extend_high = [&](const VF* x, float* out) HWY_ATTR {
    const VF shared = hn::Max(x[1], x[2]), of_none = all(-std::numeric_limits<float>::infinity());
    const VF lower = hn::IfThenElse(low, hn::Max(x[0], shared), of_none),
             upper = hn::IfThenElse(up, hn::Max(x[3], shared), of_none);
    hn::Store(hn::Max(hn::Load(f, out + c), hn::Max(lower, upper)), f, out + c);
  };
  extend_low(u, bounds.u_low);
  extend_high(u, bounds.u_high);
  extend_low(v, bounds.v_low);
  extend_high(v, bounds.v_high);
  extend_high(d, bounds.d_high);
}

std::size_t BoundCasters(const RasterBlock& b, const Strip& strip, const LightAxes& axes, LightBox* parts) {
  const int lanes = static_cast<int>(hn::Lanes(f));
  Lighted rows[2];
  light_row(b, strip.first_row, axes, rows[0]);
  std::size_t count = 0;
  for (int first = 0; first < strip.rows; first += kPartQuads) {
    ColumnBounds bounds;
    for (int r = first; r < std::min(first + kPartQuads, strip.rows); ++r) {
      const Lighted& south = rows[r & 1];
      Lighted& north = rows[(r + 1) & 1];
      light_row(b, strip.first_row + r + 1, axes, north);
      for (int c = 0; c < b.quads; c += lanes) extend(south, north, c, bounds);
    }
    for (int c = 0; c < b.quads; c += kPartQuads) {
      const LightBox box = bounds.over(c, std::min(c + kPartQuads, b.quads));
      if (box.u_low <= box.u_high) parts[count++] = box;
    }
  }
  return count;
}

void CastSkirt(const Skirt& skirt, const LightAxes& axes, LightBand& band) {
  const auto dot = [](const float* a, const float* p) { return all(a[0] * p[0] + a[1] * p[1] + a[2] * p[2]); };
  const VF u[3] = {dot(axes.u, skirt.a), dot(axes.u, skirt.b), dot(axes.u, skirt.c)},
           v[3] = {dot(axes.v, skirt.a), dot(axes.v, skirt.b), dot(axes.v, skirt.c)},
           d[3] = {dot(axes.d, skirt.a), dot(axes.d, skirt.b), dot(axes.d, skirt.c)};
  const MF active = casting(u, v, false, hn::FirstN(f, 1), band);
  if (!hn::AllFalse(f, active)) cast<false>(u, v, d, active, band);
}

void RangeOf(const float* x, std::size_t n, float& low, float& high) {
  const std::size_t lanes = hn::Lanes(f);
  VF least = all(x[0]), most = least;
  std::size_t k = 0;
  for (; k + lanes <= n; k += lanes) {
    const VF v = hn::LoadU(f, x + k);
    least = hn::Min(least, v);
    most = hn::Max(most, v);
  }
  low = hn::GetLane(hn::MinOfLanes(f, least));
  high = hn::GetLane(hn::MaxOfLanes(f, most));
  for (; k < n; ++k) {
    low = std::min(low, x[k]);
    high = std::max(high, x[k]);
  }
}

void FindLeast(LightBand& band, int c0, int c1, int r0, int r1) {
  const std::size_t lanes = hn::Lanes(f);
  for (int r = r0; r <= r1; ++r) {
    const std::uint32_t* start = &band.start[static_cast<std::size_t>(r) * static_cast<std::size_t>(band.columns)];
    for (int q = c0 / LightBand::kCoarse; q <= c1 / LightBand::kCoarse; ++q) {
      const std::size_t first = start[q * LightBand::kCoarse];
      const std::size_t past_last = start[std::min(band.columns, (q + 1) * LightBand::kCoarse)];
      VF least = all(std::numeric_limits<float>::infinity());
      std::size_t k = first;
      for (; k + lanes <= past_last; k += lanes) least = hn::Min(least, hn::LoadU(f, band.d.data() + k));
      if (k < past_last)
        least = hn::Min(least, hn::IfThenElse(hn::FirstN(f, past_last - k), hn::LoadU(f, band.d.data() + k), least));
      band.least_of(r, q) = hn::GetLane(hn::MinOfLanes(f, least));
    }
  }
}

// ---- triangles with homogeneous edges -----------------------------------------------------------------------------

// n pixels of a row; sx, sy: their samples.
void DrawHomogeneous(const HomogeneousTriangle& t, const float* HWY_RESTRICT sx, const float* HWY_RESTRICT sy,
                     std::size_t n, float* HWY_RESTRICT nearness, std::uint32_t* HWY_RESTRICT triangle) {
  std::int32_t in[HomogeneousTriangle::kMostPixels];
  std::fill_n(in, n, 1);
  for (const HomogeneousTriangle::Edge& edge : t.edges) {
    if (edge.in_guard_band) {
      const float ox = edge.ox;
      const float oy = edge.oy;
      const float ex = edge.ex;
      const float ey = edge.ey;
      const float turn = edge.flip ? -1 : 1;
      SELENOGRAPH_INDEPENDENT_LANES
      for (std::size_t i = 0; i < n; ++i) in[i] = turn * (ex * (sy[i] - oy) - ey * (sx[i] - ox)) >= 0 ? in[i] : 0;
    } else {
      const double x = edge.plane.x;
      const double y = edge.plane.y;
      const double one = edge.plane.one;
      const double turn = edge.flip ? -1 : 1;
      SELENOGRAPH_INDEPENDENT_LANES
      for (std::size_t i = 0; i < n; ++i)
        in[i] = turn * (x * static_cast<double>(sx[i]) + y * static_cast<double>(sy[i]) + one) >= 0 ? in[i] : 0;
    }
  }
  const double ix = t.inverse.x;
  const double iy = t.inverse.y;
  const double i1 = t.inverse.one;
  const double near0 = t.near0;
  const double near1 = t.near1;
  const double offset = t.offset;
  const std::uint32_t name = t.name;
  SELENOGRAPH_INDEPENDENT_LANES
  for (std::size_t i = 0; i < n; ++i) {
    const double inverse = ix * static_cast<double>(sx[i]) + iy * static_cast<double>(sy[i]) + i1;
    const auto here = static_cast<float>(near0 * inverse - near1 * (1 - offset * inverse));
    const bool nearer = in[i] != 0 && inverse > 0 && here > nearness[i];
    nearness[i] = nearer ? here : nearness[i];
    triangle[i] = nearer ? name : triangle[i];
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
HWY_EXPORT(BoundCasters);
HWY_EXPORT(FindLeast);
HWY_EXPORT(RangeOf);

void TileBuffer::clear(int width, int height) {
  const std::size_t n = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  nearness.assign(n + kTilePadding, kFarthest);  // vectors reach beyond the last pixel
  triangle.assign(n + kTilePadding, kNoTriangle);
}

namespace {

class HomogeneousDrawer {
  using Plane = HomogeneousTriangle::Plane;
  using Edge = HomogeneousTriangle::Edge;

 public:
  HomogeneousDrawer(const RasterBlock& block, const TileView& view, TileBuffer& out)
      : block_(block), view_(view), out_(out) {}

  // Two rows of corners at a time: of most rows and triangles no more is looked at than on which sides of the tile they
  // are.
  void draw_all(const Strip& strip) {
    unsigned south_beyond = 0, north_beyond = 0;
    for (int r = strip.first_row; r <= strip.first_row + strip.rows; ++r) {
      std::swap(south_, north_);
      south_beyond = std::exchange(north_beyond, ~0U);
      for (int c = 0; c <= block_.quads; ++c) {
        const Corner& here = north_[static_cast<std::size_t>(c)] = corner(r, c);
        if (!std::isnan(here.z)) north_beyond &= here.beyond;
      }
      if (r == strip.first_row || (south_beyond & north_beyond) != 0) continue;
      for (int c = 0; c < block_.quads; ++c)
        for (const bool upper : {false, true}) draw({strip.block, r - 1, c, upper});
    }
  }

 private:
  struct Corner {
    double x, y, z;  // x / z and y / z are pixels
    float px, py;
    bool in_guard_band;  // only then px and py are of use
    unsigned beyond;     // behind the eye, left, right, above, below of the tile: a bit each
  };

  void draw(const TriangleId& id) {
    const dem::QuadVertices q = id.vertices();
    const auto at = [&](int k) -> const Corner& {
      return (q.r[k] == id.r() ? south_ : north_)[static_cast<std::size_t>(q.c[k])];
    };
    // Corners a (or d), b, c as in whole strips.
    const Corner &a = at(0), &b = at(id.upper() ? 2 : 1), &c = at(id.upper() ? 1 : 2);
    if (a.beyond & b.beyond & c.beyond || std::isnan(a.z) || std::isnan(b.z) || std::isnan(c.z)) return;
    // Twice the volume over the triangle, and the edges' signs inside: as `turn` has them.
    const double volume = a.x * (b.y * c.z - b.z * c.y) - a.y * (b.x * c.z - b.z * c.x) + a.z * (b.x * c.y - b.y * c.x);
    if (volume == 0) return;
    const bool positive = (volume > 0) != id.upper();  // of a, b, c; of d, c, b
    const bool flip = id.upper() == positive;
    // 1 / depth at a pixel: the sum of the three weights.
    const Plane n[3] = {plane(b, c), plane(c, a), plane(a, b)};
    const Plane inverse{(n[0].x + n[1].x + n[2].x) / volume, (n[0].y + n[1].y + n[2].y) / volume,
                        (n[0].one + n[1].one + n[2].one) / volume};
    const HomogeneousTriangle triangle{{id.upper() ? edge(c, a, flip) : edge(a, b, flip),
                                        id.upper() ? edge(b, a, !flip) : edge(a, c, !flip), edge(b, c, flip)},
                                       inverse,
                                       static_cast<double>(view_.near0),
                                       static_cast<double>(view_.near1),
                                       static_cast<double>(view_.offset[2]),
                                       id.packed()};
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

  void draw_row(const HomogeneousTriangle& triangle, int x0, int x1, int y) {
    constexpr int kMost = HomogeneousTriangle::kMostPixels;
    for (int x = x0; x <= x1; x += kMost) {
      const auto n = static_cast<std::size_t>(std::min(kMost, x1 + 1 - x));
      const std::size_t at =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(view_.width) + static_cast<std::size_t>(x);
      float sx[kMost], sy[kMost];
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

  Corner corner(int r, int c) const {
    const std::size_t at =
        static_cast<std::size_t>(r) * static_cast<std::size_t>(block_.stride) + static_cast<std::size_t>(c);
    const float x = block_.x[at] - view_.pivot[0], y = block_.y[at] - view_.pivot[1], z = block_.z[at] - view_.pivot[2];
    const auto dot = [&](int k) {
      return (view_.row[k][0] * x + (view_.row[k][1] * y + view_.row[k][2] * z)) + view_.offset[k];
    };
    Corner out{};
    const float h[3] = {dot(0), dot(1), dot(2)};
    const float inverse = 1 / h[2];
    out.x = static_cast<double>(h[0]);
    out.y = static_cast<double>(h[1]);
    out.z = static_cast<double>(h[2]);
    out.px = h[0] * inverse;
    out.py = h[1] * inverse;
    out.in_guard_band = engine::in_guard_band(h[2], out.px, out.py, view_.least_depth);
    const double aside = static_cast<double>(view_.slack[0]);
    const double above = static_cast<double>(view_.slack[1]);
    const bool beyond[]{out.z <= 0, out.x<-(1 + aside) * out.z, out.x>(view_.width + aside) * out.z,
                        out.y<-(1 + above) * out.z, out.y>(view_.height + above) * out.z};
    for (unsigned k = 0; k < std::size(beyond); ++k) out.beyond |= unsigned{beyond[k]} << k;
    return out;
  }

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
  std::array<Corner, 65> south_, north_;  // as many quads as TriangleId tells apart
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

std::size_t bound_casters(const RasterBlock& block, const Strip& strip, const LightAxes& axes, LightBox* parts) {
  return HWY_DYNAMIC_DISPATCH(BoundCasters)(block, strip, axes, parts);
}

void range_of(const float* x, std::size_t n, float& low, float& high) {
  HWY_DYNAMIC_DISPATCH(RangeOf)(x, n, low, high);
}

void find_least(LightBand& band, int c0, int c1, int r0, int r1) {
  HWY_DYNAMIC_DISPATCH(FindLeast)(band, c0, c1, r0, r1);
}

void cast_skirt(const Skirt& skirt, const LightAxes& axes, LightBand& band) {
  HWY_DYNAMIC_DISPATCH(CastSkirt)(skirt, axes, band);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
