#include "engine/indirect/march.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/indirect/march.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Loops over lanes that end in a single answer are not vectorised by compilers: they are written out.
using Sixteen = hn::CappedTag<float, kPacket>;
inline constexpr int kLanes = static_cast<int>(HWY_MIN(HWY_LANES(float), kPacket));

inline constexpr float kNothing = -std::numeric_limits<float>::infinity();

// The steps of a march: how far, and over which grid.
class Steps {
 public:
  Steps(std::span<const GridView> grids, float farthest_m) : grids_(grids), farthest_m_(farthest_m) {}
  bool next() {
    before_m_ = at_m_;
    const float step = std::max(grids_.front().spacing_m, at_m_ * (1 / kStepsPerDistance));
    at_m_ += step;
    while (grid_ + 1 < grids_.size() && grids_[grid_ + 1].spacing_m * kPostsPerStep <= step) ++grid_;
    ++number_;
    return at_m_ < farthest_m_;
  }
  float at_m() const { return at_m_; }
  // After a share of the last step.
  float at(float share) const { return before_m_ + share * (at_m_ - before_m_); }
  bool looks_ahead() const { return number_ % 4 == 0; }
  std::size_t grid() const { return grid_; }

 private:
  std::span<const GridView> grids_;
  float farthest_m_, at_m_ = 0, before_m_ = 0;
  std::size_t grid_ = 0;
  unsigned number_ = 0;
};

// What a march's steps have in common.
struct Way {
  std::span<const GridView> grids;
  const MarchLanes& lanes;
  int stride;
  float x, y;                        // of the middle lane, in radii of the plane
  float ux, uy;                      // its direction, radii of the plane per metre
  float turn_per_m;                  // sine of the angle at the Moon's centre, next to the datum's point
  float datum_radius_m, per_radius;  // per_radius: of height 0
};

Way WayOf(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride) {
  constexpr int kMiddle = kPacket / 2;
  const float inverse = 1 / sphere.datum_radius_m, x = lanes.x[kMiddle] * inverse, y = lanes.y * inverse,
              beside = x * lanes.uy - y * lanes.ux;
  return {grids,
          lanes,
          stride,
          x,
          y,
          lanes.ux * inverse,
          lanes.uy * inverse,
          inverse * std::sqrt((1 + beside * beside) / (1 + x * x + y * y)),
          sphere.datum_radius_m,
          1 / sphere.reference_radius_m};
}

// Columns of sixteen cells of a row, as vectors of which the first lane is `first`: where the posts west and east of
// each place are among what is loaded of a row, and how far it is from the one to the other.
template <class D>
class Columns {
 public:
  using V = hn::Vec<D>;
  HWY_INLINE Columns(D d, const RowOfCells& cells, int first) : pitch_(cells.pitch) {
    const float at = cells.column + static_cast<float>(first) * cells.pitch;
    base_ = static_cast<int>(at);
    if (pitch_ >= 1) {
      share_ = hn::Set(d, at - static_cast<float>(base_));
      local_ = hn::Zero(di_);
      return;
    }
    const auto place = hn::Add(hn::Set(d, at), hn::Mul(hn::Iota(d, 0.F), hn::Set(d, pitch_)));
    const auto whole = hn::ConvertTo(di_, place);
    local_ = hn::Sub(whole, hn::Set(di_, base_));
    share_ = hn::Sub(place, hn::ConvertTo(d, whole));
    count_ = static_cast<int>(at + static_cast<float>(kLanes - 1) * pitch_) - base_ + 1;
  }
  // Reads no cell that no place is in: it may not be lit yet.
  HWY_INLINE V west(D d, const float* row) const {
    if (pitch_ < 1)
      return hn::TableLookupLanes(hn::MaskedLoad(hn::FirstN(d, static_cast<std::size_t>(count_)), d, row + base_),
                                  hn::IndicesFromVec(d, local_));
    return apart(d, row).west;
  }
  // Between four posts: `north` of the way from one row to the next.
  HWY_INLINE V between(D d, const float* south_row, const float* north_row, V north) const {
    const auto along = [&](V south, V to) { return hn::Add(south, hn::Mul(north, hn::Sub(to, south))); };
    if (pitch_ < 1) {
      // The posts of a column first: there are fewer of them than places.
      const V posts = along(hn::LoadU(d, south_row + base_), hn::LoadU(d, north_row + base_));
      const V west = hn::TableLookupLanes(posts, hn::IndicesFromVec(d, local_)),
              east = hn::TableLookupLanes(posts, hn::IndicesFromVec(d, hn::Add(local_, hn::Set(di_, 1))));
      return hn::Add(west, hn::Mul(share_, hn::Sub(east, west)));
    }
    const Pair s = apart(d, south_row), n = apart(d, north_row);
    const V west = along(s.west, n.west), east = along(s.east, n.east);
    return hn::Add(west, hn::Mul(share_, hn::Sub(east, west)));
  }

 private:
  struct Pair {
    V west, east;
  };
  // Places at least a post apart.
  HWY_INLINE Pair apart(D d, const float* row) const {
    Pair out{hn::Zero(d), hn::Zero(d)};
    if (pitch_ == 1) {
      out.west = hn::LoadU(d, row + base_);
      out.east = hn::LoadU(d, row + base_ + 1);
    } else if (pitch_ == 2) {
      hn::LoadInterleaved2(d, row + base_, out.west, out.east);
    } else {
      V third, fourth;
      hn::LoadInterleaved4(d, row + base_, out.west, out.east, third, fourth);
    }
    return out;
  }

  const hn::Rebind<std::int32_t, D> di_{};
  float pitch_;
  int base_, count_ = kLanes;
  hn::Vec<hn::Rebind<std::int32_t, D>> local_;
  V share_;
};

RowOfCells CellsAt(const Way& way, const GridView& grid, float at_m) {
  const MarchLanes& lanes = way.lanes;
  const float posts = grid.posts_per_m, row = (lanes.y + at_m * lanes.uy - grid.first_m) * posts;
  const int whole = static_cast<int>(row);
  return {whole, (lanes.x[0] + at_m * lanes.ux - grid.first_m) * posts, static_cast<float>(way.stride) / grid.coarser,
          row - static_cast<float>(whole)};
}

bool Inside(const GridView& grid, const RowOfCells& cells) {
  const float last = static_cast<float>(grid.side - 1);
  return cells.row >= 0 && cells.row < grid.side - 1 && cells.north >= 0 && cells.column >= 0 &&
         cells.column + static_cast<float>(kPacket - 1) * cells.pitch < last;
}

// Of the grids from `grid` on the first that all places meet after that way; past the last: none.
std::size_t Covering(const Way& way, std::size_t grid, float at_m, RowOfCells& cells) {
  for (; grid < way.grids.size(); ++grid)
    if (cells = CellsAt(way, way.grids[grid], at_m); Inside(way.grids[grid], cells)) break;
  return grid;
}

// The tangent of the elevation at which each lane sees the ground at a distance; NaN where there is no data. The angle
// at the Moon's centre is that of the middle lane.
void Tangents(const Way& way, std::size_t first, float at_m, float* tangent) {
  RowOfCells cells;
  const std::size_t covering = Covering(way, first, at_m, cells);
  if (covering == way.grids.size()) {
    for (int i = 0; i < kPacket; ++i) tangent[i] = std::numeric_limits<float>::quiet_NaN();
    return;
  }
  const GridView& grid = way.grids[covering];
  const float tx = way.x + at_m * way.ux, ty = way.y + at_m * way.uy, level = tx * tx + ty * ty,
              // 1 / sqrt(1 + level), up to 1e-6.
      sine = at_m * way.turn_per_m * (1 - level * (0.5F - 0.375F * level)), square = sine * sine,
              half = sine * (0.5F + square * (0.125F + square * 0.0625F)), scale = way.per_radius / sine;
  const float* south_row = grid.heights + static_cast<std::ptrdiff_t>(cells.row) * grid.side;
  const Sixteen d;
  const auto one = hn::Set(d, 1.F), north = hn::Set(d, cells.north);
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto height = Columns<Sixteen>(d, cells, i).between(d, south_row, south_row + grid.side, north);
    // 1 / (1 + h / R) to (h / R)^3.
    const auto part = hn::Mul(height, hn::Set(d, way.per_radius));
    const auto nearer = hn::Sub(one, hn::Mul(part, hn::Sub(one, part)));
    const auto rise = hn::Mul(hn::Sub(height, hn::Load(d, way.lanes.height + i)), hn::Set(d, scale));
    hn::Store(hn::Sub(hn::Mul(rise, nearer), hn::Set(d, half)), d, tangent + i);
  }
}

// Whether no ground from here on rises above what any lane has, by more than a strip that sends next to nothing.
bool Over(const Way& way, const GridView& grid, float at_m, const float* has) {
  constexpr float kStrip = 1.F / 1024;
  const Sixteen d;
  const auto zero = hn::Zero(d), distance = hn::Set(d, at_m), radius = hn::Set(d, way.datum_radius_m);
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto above = hn::Sub(hn::Set(d, grid.highest_m), hn::Load(d, way.lanes.height + i));
    // -|a| / t - t / 2R is largest at t = sqrt(2 R |a|).
    const auto turn = hn::Sqrt(hn::Mul(hn::Add(radius, radius), hn::Max(hn::Neg(above), zero)));
    const auto t = hn::Max(turn, distance);
    const auto part = hn::IfThenElse(hn::Lt(above, zero), hn::Set(d, 1.02F), hn::Set(d, 0.98F));
    const auto bound = hn::Sub(hn::Div(above, hn::Mul(part, t)), hn::Div(t, hn::Set(d, 2.1F * way.datum_radius_m)));
    if (!hn::AllFalse(d, hn::Gt(bound, hn::Add(hn::Load(d, has + i), hn::Set(d, kStrip))))) return false;
  }
  return true;
}

// What lanes have found, and what the last step added to it: 0 where it added nothing.
struct alignas(64) Found {
  float tangent[kPacket], rise[kPacket];
};

// Whether the ground between two steps matters: a lane's crest lies there, or a wall.
bool Refines(const Found& found, const float* here) {
  constexpr float kCrest = 1.F / 256, kWall = 1.F / 32;
  const Sixteen d;
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto has = hn::Load(d, found.tangent + i), now = hn::Load(d, here + i), rise = hn::Load(d, found.rise + i);
    const auto crest = hn::And(hn::Lt(now, has), hn::Gt(rise, hn::Set(d, kCrest)));
    const auto wall = hn::And(hn::Gt(now, hn::Add(has, hn::Set(d, kWall))), hn::Gt(has, hn::Set(d, kNothing)));
    if (!hn::AllFalse(d, hn::Or(crest, wall))) return true;
  }
  return false;
}

// Whether any lane sees ground that it has not seen.
bool Sees(const Found& found, const float* here) {
  const Sixteen d;
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto has = hn::Load(d, found.tangent + i);
    const auto higher = hn::And(hn::Gt(hn::Load(d, here + i), has), hn::Gt(has, hn::Set(d, kNothing)));
    if (!hn::AllFalse(d, higher)) return true;
  }
  return false;
}

void Rise(const float* here, Found& found) {
  const Sixteen d;
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto has = hn::Load(d, found.tangent + i), now = hn::Load(d, here + i);
    const auto higher = hn::Gt(now, has);
    hn::Store(hn::IfThenElseZero(higher, hn::Sub(now, has)), d, found.rise + i);
    hn::Store(hn::IfThenElse(higher, now, has), d, found.tangent + i);
  }
}

// see(grid's index, middle of the step, tangents at its end) for each step, before `found` takes them; enough(grid,
// distance) ends it.
template <typename See, typename Enough>
void Go(const Way& way, float farthest_m, Found& found, const See& see, const Enough& enough) {
  alignas(64) float here[kPacket], between[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    found.tangent[i] = kNothing;
    found.rise[i] = 0;
  }
  for (Steps steps(way.grids, farthest_m); steps.next();) {
    const std::size_t grid = steps.grid();
    Tangents(way, grid, steps.at_m(), here);
    constexpr float kPart = 0.25F;
    const bool refines = Refines(found, here);
    // The crest may lie before the last step's end.
    for (float share = -1 + kPart; refines && share < 1; share += kPart) {
      if (share == 0) continue;
      Tangents(way, grid, steps.at(share), between);
      see(grid, steps.at(share - kPart / 2), between);
      Rise(between, found);
    }
    see(grid, steps.at(refines ? 1 - kPart / 2 : 0.5F), here);
    Rise(here, found);
    if (steps.looks_ahead() && enough(way.grids[grid], steps.at_m())) break;
  }
}

void Horizons(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride,
              const float* enough, float* tangent) {
  const Way way = WayOf(grids, sphere, lanes, stride);
  Found found;
  Go(
      way, sphere.farthest_m, found, [](std::size_t, float, const float*) {},
      [&](const GridView& grid, float at_m) {
        alignas(64) float goal[kPacket];
        for (int i = 0; i < kPacket; ++i) {
          const float has = found.tangent[i];
          goal[i] = has > enough[i] ? std::numeric_limits<float>::infinity() : has;
        }
        return Over(way, grid, at_m, goal);
      });
  for (int i = 0; i < kPacket; ++i) tangent[i] = found.tangent[i];
}

// The integrals over the elevation from tangent a to b > a.
void Integrals(const float* from, const float* to, SeenPiece& piece) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const bool sees = (to[i] > from[i]) & (from[i] > kNothing);
    const float a = sees ? from[i] : 0, b = sees ? to[i] : 0;
    const float square_a = 1 + a * a, square_b = 1 + b * b, both = 1 / (square_a * square_b);
    const float da = both * square_b, db = both * square_a;
    // Of cross / turn as x / (1 + 0.28 x^2): it is at most 5e-3 off, where a cliff fills the view.
    const float cross = b - a, turn = 1 + a * b, angle = cross * turn / (turn * turn + 0.28F * cross * cross);
    const float along = 0.5F * (angle + b * db - a * da), up = 0.5F * (b * b * db - a * a * da);
    piece.along[i] = sees ? along : 0;
    piece.up[i] = sees ? up : 0;
    piece.tangent[i] = 0.5F * (a + b);
  }
}

void Pieces(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride,
            std::vector<SeenPiece>& pieces, float* horizon) {
  const Way way = WayOf(grids, sphere, lanes, stride);
  Found found;
  const auto see = [&](std::size_t grid, float middle_m, const float* here) {
    if (!Sees(found, here)) return;
    RowOfCells cells;
    const std::size_t covering = Covering(way, grid, middle_m, cells);
    if (covering == grids.size()) return;
    SeenPiece& piece = pieces.emplace_back();
    piece.grid = covering;
    piece.cells = cells;
    Integrals(found.tangent, here, piece);
  };
  Go(way, sphere.farthest_m, found, see,
     [&](const GridView& grid, float at_m) { return Over(way, grid, at_m, found.tangent); });
  for (int i = 0; i < kPacket; ++i) horizon[i] = found.tangent[i];
}

// Over the elevation from atan t to pi / 2: integrals of cos^2, (pi / 2 - atan t - t / (1 + t^2)) / 2, and of sin cos.
void Sky(const AzimuthLanes& lanes, const float* horizon, float (*sum)[kPacket]) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float h = horizon[i], t = h > -2 ? h : (h > kNothing ? -2.F : 0.F), size = t < 0 ? -t : t;
    const float near = size < 1 ? size : 1 / size, part = near / (1 + 0.28F * near * near);
    const float angle = size < 1 ? part : 1.5707963F - part, square = 1 / (1 + t * t);
    const float along = 0.5F * (1.5707963F - (t < 0 ? -angle : angle) - t * square), up = 0.5F * square;
    for (int k = 0; k < 3; ++k) sum[k][i] += along * lanes.along[k][i] + up * lanes.up[k][i];
  }
}

struct alignas(64) SeenGround {
  float nx[kPacket], ny[kPacket], albedo[kPacket];
};

bool LightPiece(const SeenPiece& piece, const GridView& grid, const AzimuthLanes& lanes, bool glows, PieceLight& out) {
  const GroundLight& light = *grid.light;
  const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(piece.cells.row) * grid.side;
  SeenGround ground;
  const Sixteen d;
  auto most = hn::Zero(d);
  for (int i = 0; i < kPacket; i += kLanes) {
    const Columns<Sixteen> columns(d, piece.cells, i);
    const auto seen = hn::Gt(hn::Load(d, piece.along + i), hn::Zero(d));
    const auto lit = hn::IfThenElseZero(seen, columns.west(d, light.lit.data() + row));
    const auto glow = glows ? hn::IfThenElseZero(seen, columns.west(d, light.glow.data() + row)) : hn::Zero(d);
    hn::Store(lit, d, out.lit + i);
    hn::Store(glow, d, out.glow + i);
    most = hn::Max(most, hn::Max(lit, glow));
  }
  if (hn::AllFalse(d, hn::Gt(most, hn::Zero(d)))) return false;
  for (int i = 0; i < kPacket; i += kLanes) {
    const Columns<Sixteen> columns(d, piece.cells, i);
    hn::Store(columns.west(d, light.nx.data() + row), d, ground.nx + i);
    hn::Store(columns.west(d, light.ny.data() + row), d, ground.ny + i);
    const auto albedo = light.albedo.empty() ? hn::Set(d, 1.F) : columns.west(d, light.albedo.data() + row);
    hn::Store(albedo, d, ground.albedo + i);
  }
  const float sx = lanes.sun[0], sy = lanes.sun[1], sz = lanes.sun[2];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float nx = ground.nx[i], ny = ground.ny[i], square = 1 - nx * nx - ny * ny,
                nz = std::sqrt(square > 0 ? square : 0);
    const float level = 1 / std::sqrt(1 + piece.tangent[i] * piece.tangent[i]), upward = piece.tangent[i] * level;
    const float x = level * lanes.along[0][i] + upward * lanes.up[0][i],
                y = level * lanes.along[1][i] + upward * lanes.up[1][i],
                z = level * lanes.along[2][i] + upward * lanes.up[2][i];
    const float mu0 = nx * sx + ny * sy + nz * sz, mu = -(x * nx + y * ny + z * nz);
    out.mu0[i] = static_cast<double>(mu0 > 1e-9F ? mu0 : 1e-9F);
    out.mu[i] = static_cast<double>(mu > 0 ? mu : 0);
    out.cos_phase[i] = static_cast<double>(-(x * sx + y * sy + z * sz));
    out.albedo[i] = static_cast<double>(ground.albedo[i]);
  }
  return true;
}

void SumPiece(const SeenPiece& piece, const AzimuthLanes& lanes, const PieceLight& light, const double* reflected,
              bool times_albedo, float (*sum)[kPacket]) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double factor = times_albedo ? light.albedo[i] : 1;
    const float direct = light.lit[i] > 0 ? light.lit[i] * static_cast<float>(reflected[i] * factor) : 0,
                radiance = direct + light.glow[i];
    const float along = radiance * piece.along[i], up = radiance * piece.up[i];
    sum[0][i] += along * lanes.along[0][i] + up * lanes.up[0][i];
    sum[1][i] += along * lanes.along[1][i] + up * lanes.up[1][i];
    sum[2][i] += along * lanes.along[2][i] + up * lanes.up[2][i];
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(Horizons);
HWY_EXPORT(Pieces);
HWY_EXPORT(LightPiece);
HWY_EXPORT(SumPiece);
HWY_EXPORT(Sky);

void find_horizons(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride,
                   const float* enough, float* tangent) {
  HWY_DYNAMIC_DISPATCH(Horizons)(grids, sphere, lanes, stride, enough, tangent);
}

void find_pieces(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride,
                 std::vector<SeenPiece>& pieces, float* horizon) {
  HWY_DYNAMIC_DISPATCH(Pieces)(grids, sphere, lanes, stride, pieces, horizon);
}

bool light_piece(const SeenPiece& piece, const GridView& grid, const AzimuthLanes& lanes, bool glows, PieceLight& out) {
  return HWY_DYNAMIC_DISPATCH(LightPiece)(piece, grid, lanes, glows, out);
}

void add_piece(const SeenPiece& piece, const AzimuthLanes& lanes, const PieceLight& light, const double* reflected,
               bool times_albedo, float (*sum)[kPacket]) {
  HWY_DYNAMIC_DISPATCH(SumPiece)(piece, lanes, light, reflected, times_albedo, sum);
}

void add_sky(const AzimuthLanes& lanes, const float* horizon, float (*sum)[kPacket]) {
  HWY_DYNAMIC_DISPATCH(Sky)(lanes, horizon, sum);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
