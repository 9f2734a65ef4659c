#include "engine/relief/ground_march.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/relief/ground_march.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "engine/relief/cell_readers.h"

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// Steps of a march: their distances from the marching points and the grid that each reads.
class Steps {
 public:
  Steps(std::span<const ReliefGrid> grids, float farthest_m) : grids_(grids), farthest_m_(farthest_m) {}
  // Takes one step; returns false once the march is beyond its farthest distance.
  bool next() {
    previous_m_ = distance_m_;
    const float step_m = std::max(static_cast<float>(grids_.front().spacing_m), distance_m_ * (1 / kStepsPerDistance));
    distance_m_ += step_m;
    while (grid_ + 1 < grids_.size() && static_cast<float>(grids_[grid_ + 1].spacing_m) * kPostsPerStep <= step_m)
      ++grid_;
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
  std::span<const ReliefGrid> grids_;
  float farthest_m_, distance_m_ = 0, previous_m_ = 0;
  std::size_t grid_ = 0;
  unsigned step_count_ = 0;
};

// Constants of a march: the direction of its sixteen lanes and the sphere. Here the gnomonic plane is scaled to a
// distance of 1 from the Moon's centre: its points are p = (x, y, 1).
struct RayMarch {
  std::span<const ReliefGrid> grids;
  float farthest_m;
  const MarchLanes& lanes;
  int stride;    // columns of the finest grid from lane to lane
  float x, y;    // position of the middle lane in the scaled plane
  float ux, uy;  // direction in the scaled plane, per metre of the march
  // With the middle lane at p and the march's end at q, the angle a between them at the Moon's centre has
  // sin a = |p x q| / (|p| |q|) = distance_m * sine_per_m / |q|.
  float sine_per_m;
  float per_radius;  // 1 / radius of height 0, 1/m
};

constexpr auto kDatumRadius_m = static_cast<float>(kMoonRadius_m);

RayMarch MakeRayMarch(const Relief& relief, std::size_t first_grid, const MarchLanes& lanes, int stride) {
  constexpr int kMiddle = kPacket / 2;
  const float inverse = 1 / kDatumRadius_m, x = lanes.x[kMiddle] * inverse, y = lanes.y * inverse;
  // The line of the march passes the plane's origin at this distance: |p x u|^2 = 1 + line_offset^2.
  const float line_offset = x * lanes.uy - y * lanes.ux;
  return {relief.grids().subspan(first_grid),
          static_cast<float>(relief.shape().farthest_m),
          lanes,
          stride,
          x,
          y,
          lanes.ux * inverse,
          lanes.uy * inverse,
          inverse * std::sqrt((1 + line_offset * line_offset) / (1 + x * x + y * y)),
          1 / static_cast<float>(relief.reference_radius_m())};
}

// Returns the cells of a grid in which the lanes' lines of sight are at this distance; Inside() tells if they exist.
RowOfCells CellsAt(const RayMarch& march, const ReliefGrid& grid, float distance_m) {
  const MarchLanes& lanes = march.lanes;
  const float row = (lanes.y + distance_m * lanes.uy) * grid.posts_per_m + grid.middle;
  const float first_column = (lanes.x[0] + distance_m * lanes.ux) * grid.posts_per_m + grid.middle;
  const int row_index = static_cast<int>(row);
  return {row_index, first_column, static_cast<float>(march.stride) / grid.coarser,
          row - static_cast<float>(row_index)};
}

// Returns true if the cells of all lanes have their four posts in the grid.
bool Inside(const ReliefGrid& grid, const RowOfCells& cells) {
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
  const ReliefGrid& grid = march.grids[covering];
  const float end_x = march.x + distance_m * march.ux, end_y = march.y + distance_m * march.uy;
  const float end_square = end_x * end_x + end_y * end_y;
  // 1 / |q| = 1 / sqrt(1 + end_square) as a series, with an error of 1e-6.
  const float sine = distance_m * march.sine_per_m * (1 - end_square * (0.5F - 0.375F * end_square));
  const float sine_square = sine * sine;
  // tan(a / 2) as a series in sin a.
  const float tan_half_angle = sine * (0.5F + sine_square * (0.125F + sine_square * 0.0625F));
  const float scale = march.per_radius / sine;
  const float* south_row = grid.heights.data() + static_cast<std::ptrdiff_t>(cells.row) * grid.side;
  const Sixteen d;
  const auto unity = hn::Set(d, 1.F), north = hn::Set(d, cells.north);
  for (int i = 0; i < kPacket; i += kLanes) {
    const auto height = RowColumns<Sixteen>(d, cells, i).height_between(d, south_row, south_row + grid.side, north);
    // 1 / (1 + h / R) as a series, with an error of (h / R)^3.
    const auto relative_height = hn::Mul(height, hn::Set(d, march.per_radius));
    const auto inverse_radius = hn::Sub(unity, hn::Mul(relative_height, hn::Sub(unity, relative_height)));
    const auto rise = hn::Mul(hn::Sub(height, hn::Load(d, march.lanes.height + i)), hn::Set(d, scale));
    hn::Store(hn::Sub(hn::Mul(rise, inverse_radius), hn::Set(d, tan_half_angle)), d, tangent + i);
  }
}

// Tangent of each lane's horizon so far, and the tangent's rise in the last step; 0 without a rise.
struct alignas(64) RunningHorizon {
  float tangent[kPacket], rise[kPacket];
};

// Returns true if no ground from this distance on, in this grid and the coarser ones, can rise above any lane's horizon
// by more than a negligible strip; a horizon above sufficient_tangent[i] is high enough. Ground higher than the lane by
// `rise` is seen at distance t under the tangent rise / t - t / 2R: the second term is the Moon's curvature.
bool NothingHigherAhead(const RayMarch& march, const ReliefGrid& grid, float distance_m, const RunningHorizon& running,
                        const float* sufficient_tangent) {
  constexpr float kNegligible = 1.F / 1024;
  const Sixteen d;
  const auto zero = hn::Zero(d), distance = hn::Set(d, distance_m), radius = hn::Set(d, kDatumRadius_m);
  return !AnyLane([&](int i) {
    const auto rise = hn::Sub(hn::Set(d, grid.highest_m), hn::Load(d, march.lanes.height + i));
    // For ground below the lane the tangent is largest at t = sqrt(2 R |rise|); for ground above it, at the nearest t.
    const auto largest_at = hn::Sqrt(hn::Mul(hn::Add(radius, radius), hn::Max(hn::Neg(rise), zero)));
    const auto t = hn::Max(largest_at, distance);
    // Factors of 1.02, 0.98 and 2.1 raise the bound, because the tangent's two terms are approximations.
    const auto margin = hn::IfThenElse(hn::Lt(rise, zero), hn::Set(d, 1.02F), hn::Set(d, 0.98F));
    const auto bound = hn::Sub(hn::Div(rise, hn::Mul(margin, t)), hn::Div(t, hn::Set(d, 2.1F * kDatumRadius_m)));
    const auto horizon = hn::Load(d, running.tangent + i);
    const auto too_low = hn::Le(horizon, hn::Load(d, sufficient_tangent + i));
    return hn::And(too_low, hn::Gt(bound, hn::Add(horizon, hn::Set(d, kNegligible))));
  });
}

// Returns true if substeps are needed between the last step and this one. A lane's crest may lie there, if the horizon
// rose in the last step and the ground now falls below it, or a wall, if the ground rises far above the horizon.
bool NeedsSubsteps(const RunningHorizon& running, const float* tangent_here) {
  constexpr float kCrest = 1.F / 256, kWall = 1.F / 32;  // smallest rise of the tangent at a crest, at a wall
  return AnyLane([&, d = Sixteen()](int i) {
    const auto horizon = hn::Load(d, running.tangent + i), now = hn::Load(d, tangent_here + i),
               rise = hn::Load(d, running.rise + i);
    const auto crest = hn::And(hn::Lt(now, horizon), hn::Gt(rise, hn::Set(d, kCrest)));
    const auto wall =
        hn::And(hn::Gt(now, hn::Add(horizon, hn::Set(d, kWall))), hn::Gt(horizon, hn::Set(d, kNoHorizon)));
    return hn::Or(crest, wall);
  });
}

// Returns true if a lane's ground ends between the last step and this one: at the border of the data or at a void.
bool LeavesData(const float* tangent_before, const float* tangent_here) {
  return AnyLane([&, d = Sixteen()](int i) {
    const auto had_data = hn::Not(hn::IsNaN(hn::Load(d, tangent_before + i)));
    return hn::And(had_data, hn::IsNaN(hn::Load(d, tangent_here + i)));
  });
}

// Returns true if the step's ground rises above the horizon of any lane that has one. A lane's first ground only begins
// its horizon: ground nearer than a step is not seen.
bool RisesAboveHorizon(const RunningHorizon& running, const float* tangent_here) {
  return AnyLane([&, d = Sixteen()](int i) {
    const auto horizon = hn::Load(d, running.tangent + i);
    return hn::And(hn::Gt(hn::Load(d, tangent_here + i), horizon), hn::Gt(horizon, hn::Set(d, kNoHorizon)));
  });
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
// or substep, before the horizon includes it. Substeps read the finest heights: coarser ones cut crests, and end up to
// a post before the border of the data. `sufficient_tangent`: see find_horizon_ahead().
template <typename OnStep>
void RunMarch(const RayMarch& march, const float* sufficient_tangent, RunningHorizon& running, const OnStep& on_step) {
  constexpr std::size_t kFinestGrid = 0;
  // Shares of a step. Ground that the last substep cuts off at the border is missing in the light; lit ground is often
  // there, at the upper end of a slope.
  constexpr float kSubstep = 0.25F, kSubstepAtBorder = 1.F / 16;
  alignas(64) float tangent_here[kPacket];
  alignas(64) float tangent_before[kPacket];  // of the last step
  alignas(64) float tangent_between[kPacket];
  for (int i = 0; i < kPacket; ++i) {
    running.tangent[i] = kNoHorizon;
    running.rise[i] = 0;
    tangent_before[i] = std::numeric_limits<float>::quiet_NaN();
  }
  for (Steps steps(march.grids, march.farthest_m); steps.next();) {
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
    if (steps.is_check_step() &&
        NothingHigherAhead(march, march.grids[grid], steps.distance_m(), running, sufficient_tangent))
      break;
  }
}

// Implements find_horizon_ahead().
void FindHorizonAhead(const Relief& relief, std::size_t first_grid, const MarchLanes& lanes, int stride,
                      const float* sufficient_tangent, float* tangent) {
  RunningHorizon running;
  RunMarch(MakeRayMarch(relief, first_grid, lanes, stride), sufficient_tangent, running,
           [](std::size_t, float, const float*) {});  // only the horizon is needed, not its segments
  std::copy_n(running.tangent, kPacket, tangent);
}

inline constexpr std::int32_t kRiseHalf = 1 << (kRiseShift - 1);  // half a code

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
    const auto has_horizon = hn::Gt(horizon, hn::Set(d, kNoHorizon));
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
void FindGround(const Relief& relief, std::size_t first_grid, const MarchLanes& lanes, GroundView& view,
                float* horizon) {
  const RayMarch march = MakeRayMarch(relief, first_grid, lanes, view.stride);
  GroundView::Azimuth& azimuth = view.azimuths.emplace_back();
  alignas(64) float sum[kPacket];
  alignas(64) float unlimited[kPacket];  // all ground is looked for, up to the highest
  std::fill_n(azimuth.first_tangent, kPacket, 0.F);
  std::fill_n(sum, kPacket, std::numeric_limits<float>::quiet_NaN());
  std::fill_n(unlimited, kPacket, std::numeric_limits<float>::infinity());
  RunningHorizon running;
  RunMarch(march, unlimited, running, [&](std::size_t grid, float middle_m, const float* tangent_here) {
    if (!RisesAboveHorizon(running, tangent_here)) return;
    RowOfCells cells;
    const std::size_t covering = FirstCoveringGrid(march, grid, middle_m, cells);
    if (covering == march.grids.size()) return;
    GroundSegment& segment = view.segments.emplace_back();
    segment.column = cells.column;
    segment.row = static_cast<std::uint16_t>(cells.row);
    segment.grid = static_cast<std::uint8_t>(covering);
    SetRises(running, tangent_here, azimuth.first_tangent, sum, segment);
  });
  std::copy_n(running.tangent, kPacket, horizon);
  azimuth.ux = lanes.ux;
  azimuth.uy = lanes.uy;
  azimuth.past_last = static_cast<std::uint32_t>(view.segments.size());
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(FindHorizonAhead);
HWY_EXPORT(FindGround);

MarchLanes posts_in_row(const Relief& relief, int row, int column, int stride) {
  const ReliefGrid& grid = relief.grids().front();
  MarchLanes lanes;
  lanes.y = static_cast<float>(grid.coordinate_m(row));
  for (int i = 0; i < kPacket; ++i) {
    lanes.x[i] = static_cast<float>(grid.coordinate_m(column + i * stride));
    lanes.height[i] = grid.heights[static_cast<std::size_t>(grid.index(column + i * stride, row))];
  }
  return lanes;
}

void find_horizon_ahead(const Relief& relief, std::size_t first_grid, const MarchLanes& lanes, int stride,
                        const float* sufficient_tangent, float* tangent) {
  HWY_DYNAMIC_DISPATCH(FindHorizonAhead)(relief, first_grid, lanes, stride, sufficient_tangent, tangent);
}

void find_visible_ground(const Relief& relief, std::size_t first_grid, const MarchLanes& lanes, GroundView& view,
                         float* horizon) {
  HWY_DYNAMIC_DISPATCH(FindGround)(relief, first_grid, lanes, view, horizon);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
