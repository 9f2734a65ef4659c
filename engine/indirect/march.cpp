#include "engine/indirect/march.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/support/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/indirect/march.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

inline constexpr float kNothing = -std::numeric_limits<float>::infinity();

// The steps of a march: how far, and over which grid.
class Steps {
 public:
  Steps(std::span<const GridView> grids, const MarchSphere& sphere) : grids_(grids), farthest_m_(sphere.farthest_m) {}
  bool next() {
    before_m_ = at_m_;
    const float step = std::max(grids_.front().spacing_m, at_m_ / kStepsPerDistance);
    at_m_ += step;
    while (grid_ + 1 < grids_.size() && grids_[grid_ + 1].spacing_m * kPostsPerStep <= step) ++grid_;
    ++number_;
    return at_m_ < farthest_m_;
  }
  float at_m() const { return at_m_; }
  // After a share of the last step.
  float at(float share) const { return before_m_ + share * (at_m_ - before_m_); }
  bool looks_ahead() const { return number_ % 4 == 0; }
  const GridView& grid() const { return grids_[grid_]; }

 private:
  std::span<const GridView> grids_;
  float farthest_m_, at_m_ = 0, before_m_ = 0;
  std::size_t grid_ = 0;
  unsigned number_ = 0;
};

struct alignas(64) Turns {
  float per_m[kPacket];  // sine of the angle at the Moon's centre, per metre of the plane, beside the datum's point
};

void Turn(const MarchSphere& sphere, const MarchLanes& lanes, Turns& out) {
  const float inverse = 1 / sphere.datum_radius_m;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float x = lanes.x[i] * inverse, y = lanes.y[i] * inverse, beside = x * lanes.uy[i] - y * lanes.ux[i];
    out.per_m[i] = inverse * std::sqrt((1 + beside * beside) / (1 + x * x + y * y));
  }
}

// The tangent of the elevation at which each lane sees the ground at a distance; NaN where there is no data.
void TangentsAt(const GridView& grid, const MarchSphere& sphere, const MarchLanes& lanes, const Turns& turns,
                float at_m, float* tangent) {
  const float inverse = 1 / sphere.datum_radius_m, posts = 1 / grid.spacing_m, first = grid.first_m,
              radius = sphere.reference_radius_m;
  const float* heights = grid.heights;
  const int side = grid.side, last = side - 2;
  const float end = static_cast<float>(side - 1);
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float x = lanes.x[i] + at_m * lanes.ux[i], y = lanes.y[i] + at_m * lanes.uy[i];
    const float column = (x - first) * posts, row = (y - first) * posts;
    int c = static_cast<int>(column), r = static_cast<int>(row);
    c = c < 0 ? 0 : c, c = c > last ? last : c;
    r = r < 0 ? 0 : r, r = r > last ? last : r;
    const float a = column - static_cast<float>(c), b = row - static_cast<float>(r);
    const int at = r * side + c;
    const float south = heights[at] + a * (heights[at + 1] - heights[at]);
    const float north = heights[at + side] + a * (heights[at + side + 1] - heights[at + side]);
    const float height = south + b * (north - south);
    const float tx = x * inverse, ty = y * inverse;
    const float sine = at_m * turns.per_m[i] / std::sqrt(1 + tx * tx + ty * ty), square = sine * sine;
    // tan of half the angle at the centre: how far the ground falls away.
    const float half = sine * (0.5F + square * (0.125F + square * 0.0625F));
    const float value = (height - lanes.height[i]) / ((radius + height) * sine) - half;
    const bool inside = column >= 0 && row >= 0 && column <= end && row <= end;
    tangent[i] = inside ? value : std::numeric_limits<float>::quiet_NaN();
  }
}

// Whether no ground from here on rises above what any lane has, by more than a strip that sends next to nothing.
bool Over(const GridView& grid, const MarchSphere& sphere, const MarchLanes& lanes, float at_m, const float* has) {
  constexpr float kStrip = 1.F / 1024;
  const float radius = sphere.datum_radius_m, highest = grid.highest_m;
  std::int32_t more = 0;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float above = highest - lanes.height[i];
    // -|a| / t - t / 2R is largest at t = sqrt(2 R |a|).
    const float turn = std::sqrt(2 * radius * (above < 0 ? -above : 0)), t = turn > at_m ? turn : at_m;
    const float bound = above / ((above < 0 ? 1.02F : 0.98F) * t) - t / (2.1F * radius);
    more |= bound > has[i] + kStrip ? 1 : 0;
  }
  return more == 0;
}

// What lanes have found, and what the last step added to it: 0 where it added nothing.
struct alignas(64) Found {
  float tangent[kPacket], rise[kPacket];
};

// Whether the ground between two steps matters: a lane's crest lies there, or a wall.
bool Refines(const Found& found, const float* here) {
  constexpr float kCrest = 1.F / 256, kWall = 1.F / 32;
  std::int32_t any = 0;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float has = found.tangent[i], now = here[i];
    const int crest = (now < has) & (found.rise[i] > kCrest), wall = (now > has + kWall) & (has > kNothing);
    any |= crest | wall;
  }
  return any != 0;
}

void Rise(const float* here, Found& found) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const bool higher = here[i] > found.tangent[i];
    found.rise[i] = higher ? here[i] - found.tangent[i] : 0;
    found.tangent[i] = higher ? here[i] : found.tangent[i];
  }
}

// see(grid, middle of the step, tangents at its end) for each step, before `found` takes them; enough(found) ends it.
template <typename See, typename Enough>
void Go(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, Found& found,
        const See& see, const Enough& enough) {
  Turns turns;
  Turn(sphere, lanes, turns);
  alignas(64) float here[kPacket], between[kPacket];
  for (int i = 0; i < kPacket; ++i) found.tangent[i] = kNothing, found.rise[i] = 0;
  for (Steps steps(grids, sphere); steps.next();) {
    const GridView& grid = steps.grid();
    TangentsAt(grid, sphere, lanes, turns, steps.at_m(), here);
    float share = 0;
    if (Refines(found, here)) {
      constexpr float kPart = 0.25F;
      for (; share < 1 - kPart; share += kPart) {
        TangentsAt(grid, sphere, lanes, turns, steps.at(share + kPart), between);
        see(grid, steps.at(share + kPart / 2), between);
        Rise(between, found);
      }
    }
    see(grid, steps.at((share + 1) / 2), here);
    Rise(here, found);
    if (steps.looks_ahead() && enough(grid, steps.at_m())) break;
  }
}

void Horizons(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, const float* enough,
              float* tangent) {
  Found found;
  Go(
      grids, sphere, lanes, found, [](const GridView&, float, const float*) {},
      [&](const GridView& grid, float at_m) {
        alignas(64) float goal[kPacket];
        for (int i = 0; i < kPacket; ++i) {
          const float has = found.tangent[i];
          goal[i] = has > enough[i] ? std::numeric_limits<float>::infinity() : has;
        }
        return Over(grid, sphere, lanes, at_m, goal);
      });
  for (int i = 0; i < kPacket; ++i) tangent[i] = found.tangent[i];
}

// The integrals over the elevation from tangent a to b > a.
void Integrals(const float* from, const float* to, SeenPiece& piece) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const bool sees = (to[i] > from[i]) & (from[i] > kNothing);
    const float a = sees ? from[i] : 0, b = sees ? to[i] : 0;
    const float da = 1 / (1 + a * a), db = 1 / (1 + b * b);
    // Between the two, b - a and atan of it differ by 5e-3 at most, where a cliff fills the view.
    const float cross = (b - a) / (1 + a * b), angle = cross / (1 + 0.28F * cross * cross);
    const float along = 0.5F * (angle + b * db - a * da), up = 0.5F * (b * b * db - a * a * da);
    piece.along[i] = sees ? along : 0, piece.up[i] = sees ? up : 0;
    piece.tangent[i] = 0.5F * (a + b);
  }
}

void CellsBeneath(const GridView& grid, const MarchLanes& lanes, float at_m, SeenPiece& piece) {
  const float posts = 1 / grid.spacing_m, first = grid.first_m;
  const int last = grid.side - 2;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float column = (lanes.x[i] + at_m * lanes.ux[i] - first) * posts,
                row = (lanes.y[i] + at_m * lanes.uy[i] - first) * posts;
    int c = static_cast<int>(column), r = static_cast<int>(row);
    c = c < 0 ? 0 : c, c = c > last ? last : c;
    r = r < 0 ? 0 : r, r = r > last ? last : r;
    piece.cell[i] = r * grid.side + c;
  }
}

void Pieces(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes,
            std::vector<SeenPiece>& pieces) {
  Found found;
  const auto see = [&](const GridView& grid, float middle_m, const float* here) {
    std::int32_t seen = 0;
    SELENOGRAPH_INDEPENDENT_LANES
    for (int i = 0; i < kPacket; ++i) seen |= (here[i] > found.tangent[i]) & (found.tangent[i] > kNothing);
    if (!seen) return;
    SeenPiece& piece = pieces.emplace_back();
    piece.light = grid.light;
    Integrals(found.tangent, here, piece);
    CellsBeneath(grid, lanes, middle_m, piece);
  };
  Go(grids, sphere, lanes, found, see,
     [&](const GridView& grid, float at_m) { return Over(grid, sphere, lanes, at_m, found.tangent); });
}

bool LightPiece(const SeenPiece& piece, const AzimuthLanes& lanes, PieceLight& out) {
  const GroundLight* light = piece.light;
  float any = 0;
  for (int i = 0; i < kPacket; ++i) {
    const float lit = piece.along[i] > 0 ? light[piece.cell[i]].lit : 0;
    out.lit[i] = lit, any += lit;
  }
  if (!(any > 0)) return false;
  const float sx = lanes.sun[0], sy = lanes.sun[1], sz = lanes.sun[2];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const GroundLight& ground = light[piece.cell[i]];
    const float nx = ground.nx, ny = ground.ny, square = 1 - nx * nx - ny * ny, nz = std::sqrt(square > 0 ? square : 0);
    const float level = 1 / std::sqrt(1 + piece.tangent[i] * piece.tangent[i]), upward = piece.tangent[i] * level;
    const float x = level * lanes.along[0][i] + upward * lanes.up[0][i],
                y = level * lanes.along[1][i] + upward * lanes.up[1][i],
                z = level * lanes.along[2][i] + upward * lanes.up[2][i];
    const float mu0 = nx * sx + ny * sy + nz * sz, mu = -(x * nx + y * ny + z * nz);
    out.mu0[i] = static_cast<double>(mu0 > 1e-9F ? mu0 : 1e-9F), out.mu[i] = static_cast<double>(mu > 0 ? mu : 0);
    out.cos_phase[i] = static_cast<double>(-(x * sx + y * sy + z * sz));
    out.albedo[i] = static_cast<double>(ground.albedo);
  }
  return true;
}

void SumPiece(const SeenPiece& piece, const AzimuthLanes& lanes, const PieceLight& light, const double* reflected,
              bool times_albedo, float (*sum)[kPacket]) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double factor = times_albedo ? light.albedo[i] : 1;
    const float radiance = light.lit[i] > 0 ? light.lit[i] * static_cast<float>(reflected[i] * factor) : 0;
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

void find_horizons(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes,
                   const float* enough, float* tangent) {
  HWY_DYNAMIC_DISPATCH(Horizons)(grids, sphere, lanes, enough, tangent);
}

void find_pieces(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes,
                 std::vector<SeenPiece>& pieces) {
  HWY_DYNAMIC_DISPATCH(Pieces)(grids, sphere, lanes, pieces);
}

bool light_piece(const SeenPiece& piece, const AzimuthLanes& lanes, PieceLight& out) {
  return HWY_DYNAMIC_DISPATCH(LightPiece)(piece, lanes, out);
}

void add_piece(const SeenPiece& piece, const AzimuthLanes& lanes, const PieceLight& light, const double* reflected,
               bool times_albedo, float (*sum)[kPacket]) {
  HWY_DYNAMIC_DISPATCH(SumPiece)(piece, lanes, light, reflected, times_albedo, sum);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
