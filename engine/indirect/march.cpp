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

// Write loops that reduce sixteen lanes to one value with vectors: compilers do not vectorise them.
using Sixteen = hn::CappedTag<float, kPacket>;
inline constexpr int kLanes = static_cast<int>(HWY_MIN(HWY_LANES(float), kPacket));

inline constexpr float kNothing = -std::numeric_limits<float>::infinity();

// Steps of a march: their distances from the marching points and the grid that each reads.
class Steps {
 public:
  Steps(std::span<const GridView> grids, float farthest_m) : grids_(grids), farthest_m_(farthest_m) {}
  // Takes one step; returns false once the march is beyond its farthest distance.
  bool next() {
    previous_m_ = distance_m_;
    const float step_m = std::max(grids_.front().spacing_m, distance_m_ * (1 / kStepsPerDistance));
    distance_m_ += step_m;
    while (grid_ + 1 < grids_.size() && grids_[grid_ + 1].spacing_m * kPostsPerStep <= step_m) ++grid_;
    ++step_count_;
    return distance_m_ < farthest_m_;
  }
  float distance_m() const { return distance_m_; }
  // Returns the distance at a share of the last step; negative shares lie in the step before.
  float distance_at_share_m(float share) const { return previous_m_ + share * (distance_m_ - previous_m_); }
  // Returns true at every fourth step, where RunMarch() tests whether the march may end.
  bool is_check_step() const { return step_count_ % 4 == 0; }
  std::size_t grid() const { return grid_; }  // index of the grid that the last step reads

 private:
  std::span<const GridView> grids_;
  float farthest_m_, distance_m_ = 0, previous_m_ = 0;
  std::size_t grid_ = 0;
  unsigned step_count_ = 0;
};

// Constants of a march: the direction of its sixteen lanes and the sphere. Here the gnomonic plane is scaled to a
// distance of 1 from the Moon's centre: its points are p = (x, y, 1).
struct RayMarch {
  std::span<const GridView> grids;
  const MarchLanes& lanes;
  int stride;    // columns of the finest grid from lane to lane
  float x, y;    // position of the middle lane in the scaled plane
  float ux, uy;  // direction in the scaled plane, per metre of the march
  // With the middle lane at p and the march's end at q, the angle a between them at the Moon's centre has
  // sin a = |p x q| / (|p| |q|) = distance_m * sine_per_m / |q|.
  float sine_per_m;
  float datum_radius_m;
  float per_radius;  // 1 / radius of height 0, 1/m
};

RayMarch MakeRayMarch(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride) {
  constexpr int kMiddle = kPacket / 2;
  const float inverse = 1 / sphere.datum_radius_m, x = lanes.x[kMiddle] * inverse, y = lanes.y * inverse;
  // The line of the march passes the plane's origin at this distance: |p x u|^2 = 1 + line_offset^2.
  const float line_offset = x * lanes.uy - y * lanes.ux;
  return {grids,
          lanes,
          stride,
          x,
          y,
          lanes.ux * inverse,
          lanes.uy * inverse,
          inverse * std::sqrt((1 + line_offset * line_offset) / (1 + x * x + y * y)),
          sphere.datum_radius_m,
          1 / sphere.reference_radius_m};
}

// Loads the posts west and east of each lane from a row of a grid, one vector of lanes from `first_lane` on. Lanes are
// `pitch` columns apart: below 1 several share a column, and a table lookup spreads the loaded posts; 1 is a plain
// load; 2 and 4 are interleaved loads.
template <class D>
class Columns {
 public:
  using V = hn::Vec<D>;
  HWY_INLINE Columns(D d, const RowOfCells& cells, int first_lane) : pitch_(cells.pitch) {
    const float first_column = cells.column + static_cast<float>(first_lane) * cells.pitch;
    base_column_ = static_cast<int>(first_column);
    if (pitch_ >= 1) {
      east_share_ = hn::Set(d, first_column - static_cast<float>(base_column_));
      lane_column_ = hn::Zero(di_);
      return;
    }
    const auto position = hn::Add(hn::Set(d, first_column), hn::Mul(hn::Iota(d, 0.F), hn::Set(d, pitch_)));
    const auto column = hn::ConvertTo(di_, position);
    lane_column_ = hn::Sub(column, hn::Set(di_, base_column_));
    east_share_ = hn::Sub(position, hn::ConvertTo(d, column));
    column_count_ = static_cast<int>(first_column + static_cast<float>(kLanes - 1) * pitch_) - base_column_ + 1;
  }
  // Returns the value west of each lane. Below pitch 1 the load is masked to the cells that lanes need: the cells
  // beyond may not be lit yet.
  HWY_INLINE V west(D d, const float* row) const {
    if (pitch_ < 1)
      return hn::TableLookupLanes(
          hn::MaskedLoad(hn::FirstN(d, static_cast<std::size_t>(column_count_)), d, row + base_column_),
          hn::IndicesFromVec(d, lane_column_));
    return load_pair(d, row).west;
  }
  // Interpolates each lane's height between four posts. `north`: share of the way from the south row to the north row.
  HWY_INLINE V height_between(D d, const float* south_row, const float* north_row, V north) const {
    const auto northward = [&](V south_value, V north_value) {
      return hn::Add(south_value, hn::Mul(north, hn::Sub(north_value, south_value)));
    };
    if (pitch_ < 1) {
      // Interpolate columns first: there are fewer of them than lanes.
      const V posts = northward(hn::LoadU(d, south_row + base_column_), hn::LoadU(d, north_row + base_column_));
      const V west = hn::TableLookupLanes(posts, hn::IndicesFromVec(d, lane_column_)),
              east = hn::TableLookupLanes(posts, hn::IndicesFromVec(d, hn::Add(lane_column_, hn::Set(di_, 1))));
      return hn::Add(west, hn::Mul(east_share_, hn::Sub(east, west)));
    }
    const Pair s = load_pair(d, south_row), n = load_pair(d, north_row);
    const V west = northward(s.west, n.west), east = northward(s.east, n.east);
    return hn::Add(west, hn::Mul(east_share_, hn::Sub(east, west)));
  }

 private:
  struct Pair {
    V west, east;
  };
  // Loads the posts of lanes that are at least a column apart.
  HWY_INLINE Pair load_pair(D d, const float* row) const {
    Pair pair{hn::Zero(d), hn::Zero(d)};
    if (pitch_ == 1) {
      pair.west = hn::LoadU(d, row + base_column_);
      pair.east = hn::LoadU(d, row + base_column_ + 1);
    } else if (pitch_ == 2) {
      hn::LoadInterleaved2(d, row + base_column_, pair.west, pair.east);
    } else {
      V unused_third, unused_fourth;
      hn::LoadInterleaved4(d, row + base_column_, pair.west, pair.east, unused_third, unused_fourth);
    }
    return pair;
  }

  const hn::Rebind<std::int32_t, D> di_{};
  float pitch_;                                       // columns from lane to lane
  int base_column_;                                   // column of the first lane's western post
  int column_count_ = kLanes;                         // columns with a lane's western post; only for a pitch below 1
  hn::Vec<hn::Rebind<std::int32_t, D>> lane_column_;  // column of each lane's western post, from base_column_ on
  V east_share_;                                      // share of the way from the western to the eastern post
};

// Returns the cells of a grid in which the lanes' lines of sight are at this distance; Inside() tells if they exist.
RowOfCells CellsAt(const RayMarch& march, const GridView& grid, float distance_m) {
  const MarchLanes& lanes = march.lanes;
  const float row = (lanes.y + distance_m * lanes.uy - grid.first_m) * grid.posts_per_m;
  const float first_column = (lanes.x[0] + distance_m * lanes.ux - grid.first_m) * grid.posts_per_m;
  const int row_index = static_cast<int>(row);
  return {row_index, first_column, static_cast<float>(march.stride) / grid.coarser,
          row - static_cast<float>(row_index)};
}

// Returns true if the cells of all lanes have their four posts in the grid.
bool Inside(const GridView& grid, const RowOfCells& cells) {
  const float last_column = static_cast<float>(grid.side - 1);
  return cells.row >= 0 && cells.row < grid.side - 1 && cells.north >= 0 && cells.column >= 0 &&
         cells.column + static_cast<float>(kPacket - 1) * cells.pitch < last_column;
}

// Returns the first grid from `grid` on that extends over all lanes at this distance, and sets `cells`; the number of
// grids if there is none.
std::size_t FirstCoveringGrid(const RayMarch& march, std::size_t grid, float distance_m, RowOfCells& cells) {
  for (; grid < march.grids.size(); ++grid)
    if (cells = CellsAt(march, march.grids[grid], distance_m); Inside(march.grids[grid], cells)) break;
  return grid;
}

// Sets tangent[i] to the tangent of the elevation at which lane i sees the ground at a distance; NaN without data. With
// radii r0 of the lane and r1 of the ground, and the angle a between them at the Moon's centre, it is
// (r1 - r0) / (r1 sin a) - tan(a / 2). The middle lane's angle serves for all lanes.
void ElevationTangents(const RayMarch& march, std::size_t first_grid, float distance_m, float* tangent) {
  RowOfCells cells;
  const std::size_t covering = FirstCoveringGrid(march, first_grid, distance_m, cells);
  if (covering == march.grids.size()) {
    for (int i = 0; i < kPacket; ++i) tangent[i] = std::numeric_limits<float>::quiet_NaN();
    return;
  }
  const GridView& grid = march.grids[covering];
  const float end_x = march.x + distance_m * march.ux, end_y = march.y + distance_m * march.uy;
  const float end_square = end_x * end_x + end_y * end_y;
  // 1 / |q| = 1 / sqrt(1 + end_square) as a series, with an error of 1e-6.
  const float sine = distance_m * march.sine_per_m * (1 - end_square * (0.5F - 0.375F * end_square));
  const float sine_square = sine * sine;
  // tan(a / 2) as a series in sin a.
  const float tan_half_angle = sine * (0.5F + sine_square * (0.125F + sine_square * 0.0625F));
  const float scale = march.per_radius / sine;
  const float* south_row = grid.heights + static_cast<std::ptrdiff_t>(cells.row) * grid.side;
  const Sixteen d;
  const auto unity = hn::Set(d, 1.F), north = hn::Set(d, cells.north);
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto height = Columns<Sixteen>(d, cells, i).height_between(d, south_row, south_row + grid.side, north);
    // 1 / (1 + h / R) as a series, with an error of (h / R)^3.
    const auto relative_height = hn::Mul(height, hn::Set(d, march.per_radius));
    const auto inverse_radius = hn::Sub(unity, hn::Mul(relative_height, hn::Sub(unity, relative_height)));
    const auto rise = hn::Mul(hn::Sub(height, hn::Load(d, march.lanes.height + i)), hn::Set(d, scale));
    hn::Store(hn::Sub(hn::Mul(rise, inverse_radius), hn::Set(d, tan_half_angle)), d, tangent + i);
  }
}

// Returns true if no ground from this distance on can rise above any lane's horizon by more than a negligible strip.
// Ground higher than the lane by `rise` is seen at distance t under the tangent rise / t - t / 2R: the second term is
// the Moon's curvature. `horizon`: tangents.
bool NothingHigherAhead(const RayMarch& march, const GridView& grid, float distance_m, const float* horizon) {
  constexpr float kNegligible = 1.F / 1024;
  const Sixteen d;
  const auto zero = hn::Zero(d), distance = hn::Set(d, distance_m), radius = hn::Set(d, march.datum_radius_m);
  for (int i = 0; i < kPacket; i += kLanes) {
    // No ground ahead is higher than the highest of this grid and the coarser ones.
    const auto rise = hn::Sub(hn::Set(d, grid.highest_m), hn::Load(d, march.lanes.height + i));
    // For ground below the lane the tangent is largest at t = sqrt(2 R |rise|); for ground above it, at the nearest t.
    const auto largest_at = hn::Sqrt(hn::Mul(hn::Add(radius, radius), hn::Max(hn::Neg(rise), zero)));
    const auto t = hn::Max(largest_at, distance);
    // Factors of 1.02, 0.98 and 2.1 raise the bound, because the tangent's two terms are approximations.
    const auto margin = hn::IfThenElse(hn::Lt(rise, zero), hn::Set(d, 1.02F), hn::Set(d, 0.98F));
    const auto bound = hn::Sub(hn::Div(rise, hn::Mul(margin, t)), hn::Div(t, hn::Set(d, 2.1F * march.datum_radius_m)));
    if (!hn::AllFalse(d, hn::Gt(bound, hn::Add(hn::Load(d, horizon + i), hn::Set(d, kNegligible))))) return false;
  }
  return true;
}

// Tangent of each lane's horizon so far, and the tangent's rise in the last step; 0 without a rise.
struct alignas(64) RunningHorizon {
  float tangent[kPacket], rise[kPacket];
};

// Returns true if substeps are needed between the last step and this one. A lane's crest may lie there, if the horizon
// rose in the last step and the ground now falls below it, or a wall, if the ground rises far above the horizon.
bool NeedsSubsteps(const RunningHorizon& running, const float* tangent_here) {
  constexpr float kCrest = 1.F / 256, kWall = 1.F / 32;  // smallest rise of the tangent at a crest, at a wall
  const Sixteen d;
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto horizon = hn::Load(d, running.tangent + i), now = hn::Load(d, tangent_here + i),
               rise = hn::Load(d, running.rise + i);
    const auto crest = hn::And(hn::Lt(now, horizon), hn::Gt(rise, hn::Set(d, kCrest)));
    const auto wall = hn::And(hn::Gt(now, hn::Add(horizon, hn::Set(d, kWall))), hn::Gt(horizon, hn::Set(d, kNothing)));
    if (!hn::AllFalse(d, hn::Or(crest, wall))) return true;
  }
  return false;
}

// Returns true if a lane's ground ends between the last step and this one: at the border of the data or at a void.
bool LeavesData(const float* tangent_before, const float* tangent_here) {
  const Sixteen d;
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto had_data = hn::Not(hn::IsNaN(hn::Load(d, tangent_before + i)));
    if (!hn::AllFalse(d, hn::And(had_data, hn::IsNaN(hn::Load(d, tangent_here + i))))) return true;
  }
  return false;
}

// Returns true if the step's ground rises above the horizon of any lane that has one. A lane's first ground only begins
// its horizon: ground nearer than a step is not seen.
bool RisesAboveHorizon(const RunningHorizon& running, const float* tangent_here) {
  const Sixteen d;
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto horizon = hn::Load(d, running.tangent + i);
    const auto higher = hn::And(hn::Gt(hn::Load(d, tangent_here + i), horizon), hn::Gt(horizon, hn::Set(d, kNothing)));
    if (!hn::AllFalse(d, higher)) return true;
  }
  return false;
}

// Raises the horizons to the tangents of a step.
void RaiseHorizon(const float* tangent_here, RunningHorizon& running) {
  const Sixteen d;
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto horizon = hn::Load(d, running.tangent + i), now = hn::Load(d, tangent_here + i);
    const auto higher = hn::Gt(now, horizon);
    hn::Store(hn::IfThenElseZero(higher, hn::Sub(now, horizon)), d, running.rise + i);
    hn::Store(hn::IfThenElse(higher, now, horizon), d, running.tangent + i);
  }
}

// Runs a march. Calls on_step(index of the grid, distance of the step's middle in m, tangents at its end) for each step
// or substep, before the horizon includes it. At every fourth step, is_done(grid, distance) may end the march. Substeps
// read the finest heights: coarser ones cut crests, and end up to a post before the border of the data.
template <typename OnStep, typename IsDone>
void RunMarch(const RayMarch& march, float farthest_m, RunningHorizon& running, const OnStep& on_step,
              const IsDone& is_done) {
  constexpr std::size_t kFinestGrid = 0;
  // Shares of a step. Ground that the last substep cuts off at the border is missing in the light; lit ground is often
  // there, at the upper end of a slope.
  constexpr float kSubstep = 0.25F, kSubstepAtBorder = 1.F / 16;
  alignas(64) float tangent_here[kPacket];
  alignas(64) float tangent_before[kPacket];  // of the last step
  alignas(64) float tangent_between[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    running.tangent[i] = kNothing;
    running.rise[i] = 0;
    tangent_before[i] = std::numeric_limits<float>::quiet_NaN();
  }
  for (Steps steps(march.grids, farthest_m); steps.next();) {
    const std::size_t grid = steps.grid();
    ElevationTangents(march, grid, steps.distance_m(), tangent_here);
    const bool has_crest_or_wall = NeedsSubsteps(running, tangent_here);
    const bool leaves_data = LeavesData(tangent_before, tangent_here);
    const float substep = leaves_data ? kSubstepAtBorder : has_crest_or_wall ? kSubstep : 1;
    // Begin in the step before: the crest may lie before its end. Share 0, its end, has been evaluated.
    for (float share = has_crest_or_wall ? substep - 1 : substep; share < 1; share += substep) {
      if (share == 0) continue;
      ElevationTangents(march, kFinestGrid, steps.distance_at_share_m(share), tangent_between);
      on_step(kFinestGrid, steps.distance_at_share_m(share - substep / 2), tangent_between);
      RaiseHorizon(tangent_between, running);
    }
    on_step(grid, steps.distance_at_share_m(1 - substep / 2), tangent_here);
    RaiseHorizon(tangent_here, running);
    std::copy_n(tangent_here, kPacket, tangent_before);
    if (steps.is_check_step() && is_done(march.grids[grid], steps.distance_m())) break;
  }
}

// Implements find_horizons().
void FindHorizons(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride,
                  const float* sufficient_tangent, float* tangent) {
  const RayMarch march = MakeRayMarch(grids, sphere, lanes, stride);
  RunningHorizon running;
  const auto ignore_step = [](std::size_t, float, const float*) {};  // only the horizon is needed, not its segments
  RunMarch(march, sphere.farthest_m, running, ignore_step, [&](const GridView& grid, float distance_m) {
    // An infinite horizon makes NothingHigherAhead() ignore a lane whose horizon is high enough.
    alignas(64) float to_exceed[kPacket];
    for (int i = 0; i < kPacket; ++i) {
      const float horizon = running.tangent[i];
      to_exceed[i] = horizon > sufficient_tangent[i] ? std::numeric_limits<float>::infinity() : horizon;
    }
    return NothingHigherAhead(march, grid, distance_m, to_exceed);
  });
  for (int i = 0; i < kPacket; ++i) tangent[i] = running.tangent[i];
}

// Sets a segment's integrals over elevations from tangent a to b > a: cos^2 e gives (angle + b / (1 + b^2) - a / (1 +
// a^2)) / 2, and sin e cos e gives (b^2 / (1 + b^2) - a^2 / (1 + a^2)) / 2.
void IntegrateElevation(const float* from, const float* to, VisibleSegment& segment) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const bool visible = (to[i] > from[i]) & (from[i] > kNothing);
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

// GroundSegment::rise as bits of a float: the shift of the mantissa, and the number whose code is 0.
inline constexpr int kRiseShift = 20;
inline constexpr std::uint32_t kRiseZero = std::uint32_t{127 - 24} << 23;
inline constexpr std::int32_t kRiseHalf = 1 << (kRiseShift - 1);

// Sets the rises of a segment. `sum`: NaN where no rise was set yet; then the horizon where it began goes to `first`.
void SetRises(const RunningHorizon& running, const float* tangent_here, float* first, float* sum,
              GroundSegment& segment) {
  const Sixteen d;
  const hn::Rebind<std::int32_t, Sixteen> di;
  const hn::Rebind<std::uint8_t, Sixteen> d8;
  const auto zero_code = hn::Set(di, static_cast<std::int32_t>(kRiseZero));
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto horizon = hn::Load(d, running.tangent + i), now = hn::Load(d, tangent_here + i),
               sum_so_far = hn::Load(d, sum + i);
    const auto has_horizon = hn::Gt(horizon, hn::Set(d, kNothing));
    const auto begins = hn::And(has_horizon, hn::IsNaN(sum_so_far));
    const auto before = hn::IfThenElse(begins, horizon, sum_so_far);
    const auto visible = hn::And(has_horizon, hn::Gt(now, horizon));
    const auto rise = hn::Max(hn::IfThenElseZero(visible, hn::Sub(now, before)), hn::Zero(d));
    const auto rounded =
        hn::ShiftRight<kRiseShift>(hn::Add(hn::Sub(hn::BitCast(di, rise), zero_code), hn::Set(di, kRiseHalf)));
    const auto code = hn::Min(hn::Max(rounded, hn::Zero(di)), hn::Set(di, 255));
    const auto coded_rise = hn::IfThenElseZero(hn::RebindMask(d, hn::Gt(code, hn::Zero(di))),
                                               hn::BitCast(d, hn::Add(hn::ShiftLeft<kRiseShift>(code), zero_code)));
    hn::StoreU(hn::DemoteTo(d8, code), d8, segment.rise + i);
    hn::Store(hn::IfThenElse(begins, horizon, hn::Load(d, first + i)), d, first + i);
    hn::Store(hn::Add(before, coded_rise), d, sum + i);
  }
}

// Implements find_visible_ground().
void FindGround(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, GroundView& view,
                float* horizon) {
  const RayMarch march = MakeRayMarch(grids, sphere, lanes, view.stride);
  GroundView::Azimuth& azimuth = view.azimuths.emplace_back();
  alignas(64) float sum[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    azimuth.first_tangent[i] = 0;
    sum[i] = std::numeric_limits<float>::quiet_NaN();
  }
  RunningHorizon running;
  const auto add_segment_of_step = [&](std::size_t grid, float middle_m, const float* tangent_here) {
    if (!RisesAboveHorizon(running, tangent_here)) return;
    RowOfCells cells;
    const std::size_t covering = FirstCoveringGrid(march, grid, middle_m, cells);
    if (covering == grids.size()) return;
    GroundSegment& segment = view.segments.emplace_back();
    segment.column = cells.column;
    segment.row = static_cast<std::uint16_t>(cells.row);
    segment.grid = static_cast<std::uint8_t>(covering);
    SetRises(running, tangent_here, azimuth.first_tangent, sum, segment);
  };
  RunMarch(march, sphere.farthest_m, running, add_segment_of_step, [&](const GridView& grid, float distance_m) {
    return NothingHigherAhead(march, grid, distance_m, running.tangent);
  });
  for (int i = 0; i < kPacket; ++i) horizon[i] = running.tangent[i];
  azimuth.ux = lanes.ux;
  azimuth.uy = lanes.uy;
  azimuth.past_last = static_cast<std::uint32_t>(view.segments.size());
}

// Adds the sky above a horizon of tangent t. Over elevations from atan t to pi / 2, cos^2 integrates to (pi / 2 - atan
// t - t / (1 + t^2)) / 2, and sin cos to 1 / (1 + t^2) / 2. A horizon below a tangent of -2 counts as -2; a lane
// without ground has the level horizon, 0.
void AddSky(const AzimuthLanes& lanes, const float* horizon, float (*sum)[kPacket]) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    constexpr float kHalfPi = 1.5707963F;
    const float h = horizon[i], t = h > -2 ? h : (h > kNothing ? -2.F : 0.F), size = t < 0 ? -t : t;
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
HWY_INLINE RowOfCells CellsOfSegment(const GroundSegment& segment, const GroundView& view, const GridView& grid) {
  return {segment.row, segment.column, static_cast<float>(view.stride) / grid.coarser, 0};
}

// Adds a segment's rises to the horizons, and reads the light on its cells. Returns false if all that is visible is
// dark.
bool ReadLight(const GroundSegment& segment, const RowOfCells& cells, const GridView& grid, int glow_number,
               const float* from, float* to, SegmentLight& out) {
  const GroundLight& light = *grid.light;
  const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(segment.row) * grid.side;
  const Sixteen d;
  const hn::Rebind<std::uint8_t, Sixteen> d8;
  const hn::Rebind<std::uint32_t, Sixteen> d32;
  auto brightest = hn::Zero(d);
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto code = hn::PromoteTo(d32, hn::LoadU(d8, segment.rise + i));
    const auto visible = hn::RebindMask(d, hn::Ne(code, hn::Zero(d32)));
    const auto rise = hn::BitCast(d, hn::Add(hn::ShiftLeft<kRiseShift>(code), hn::Set(d32, kRiseZero)));
    hn::Store(hn::Add(hn::Load(d, from + i), hn::IfThenElseZero(visible, rise)), d, to + i);
    const Columns<Sixteen> columns(d, cells, i);
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
void SetAngles(const VisibleSegment& segment, const RowOfCells& cells, const GridView& grid, const AzimuthLanes& lanes,
               SegmentLight& out) {
  const GroundLight& light = *grid.light;
  const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(cells.row) * grid.side;
  GroundLanes ground;
  const Sixteen d;
  for (int i = 0; i < kPacket; i += kLanes) {
    const Columns<Sixteen> columns(d, cells, i);
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
    out.albedo[i] = static_cast<double>(ground.albedo[i]);
  }
}

// Implements next_lit_segment().
bool NextLitSegment(const GroundView& view, std::span<const GridView> grids, const AzimuthLanes& lanes, int glow,
                    SegmentCursor& cursor, VisibleSegment& segment, SegmentLight& light) {
  alignas(64) float to[kPacket];
  while (cursor.segment < cursor.past_last) {
    const GroundSegment& ground = view.segments[cursor.segment++];
    const GridView& grid = grids[ground.grid];
    const RowOfCells cells = CellsOfSegment(ground, view, grid);
    const bool lit = ReadLight(ground, cells, grid, glow, cursor.horizon, to, light);
    if (lit) {
      IntegrateElevation(cursor.horizon, to, segment);
      SetAngles(segment, cells, grid, lanes, light);
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

HWY_EXPORT(FindHorizons);
HWY_EXPORT(FindGround);
HWY_EXPORT(NextLitSegment);
HWY_EXPORT(AddSegment);
HWY_EXPORT(AddSky);

void find_horizons(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride,
                   const float* sufficient_tangent, float* tangent) {
  HWY_DYNAMIC_DISPATCH(FindHorizons)(grids, sphere, lanes, stride, sufficient_tangent, tangent);
}

void find_visible_ground(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes,
                         GroundView& view, float* horizon) {
  HWY_DYNAMIC_DISPATCH(FindGround)(grids, sphere, lanes, view, horizon);
}

SegmentCursor::SegmentCursor(const GroundView& view, std::size_t azimuth)
    : segment(azimuth == 0 ? 0 : view.azimuths[azimuth - 1].past_last), past_last(view.azimuths[azimuth].past_last) {
  std::copy_n(view.azimuths[azimuth].first_tangent, kPacket, horizon);
}

bool next_lit_segment(const GroundView& view, std::span<const GridView> grids, const AzimuthLanes& lanes, int glow,
                      SegmentCursor& cursor, VisibleSegment& segment, SegmentLight& light) {
  return HWY_DYNAMIC_DISPATCH(NextLitSegment)(view, grids, lanes, glow, cursor, segment, light);
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
