// The plan of marches to horizons over a relief: the distances of their samples, and tables of the highest posts, which
// bound the ground of several samples.
#pragma once

#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/relief/relief.h"

namespace selenograph::engine {

// ReliefShape::posts_per_distance and void_height_m of a relief for horizons. So a post is never wider than 1/1000 of
// its distance, except next to the place.
inline constexpr double kHorizonPostsPerDistance = 1000;
inline constexpr float kVoidHeight_m = -1e5F;

// The highest posts around the cells of a coarser grid: cell (i, j) has those in the rows and columns from
// (i - radius) << cell_log2 to (i + radius + 1) << cell_log2.
struct HighestPosts {
  std::vector<float> heights;
  int side;
  int cell_log2;
  int radius;
  // Returns the distance from any point of a cell up to which its value includes all posts, in posts.
  float reach_posts() const { return static_cast<float>(radius << cell_log2); }
};

// Ground at an angle a from the place. tangent of its elevation = (height - own height) / (1 + height / R) rise_per_m -
// drop, with rise_per_m = 1 / (R sin a) and drop = tan(a / 2).
struct MarchSample {
  float plane_m;    // R tan(a)
  float tan_angle;  // tan(a)
  float rise_per_m, drop;
};

// A run of samples in one grid.
struct MarchSegment {
  int grid;
  int first, past_last;            // samples
  int first_part, past_last_part;  // parts, each a short segment; none: samples are read at once
  float middle_m, tan_middle;      // of its middle, as in MarchSample
  float half_m, far_m;             // half its length, and distance of its end, on the plane
  float near_rise_per_m, far_rise_per_m, near_drop;
};

// All that marches of one tile have in common. Samples before `near_samples` lie in the first grid and are always read.
struct MarchPlan {
  std::span<const ReliefGrid> grids;
  std::vector<std::vector<HighestPosts>> highest;  // tables of each grid, by increasing reach
  std::vector<MarchSample> samples;
  int near_samples = 0;
  std::vector<MarchSegment> segments, parts;
  float per_radius = 0;    // 1 / radius of height 0, 1/m
  float radius_ratio = 1;  // radius of the datum over that of height 0
};

// Returns the plan of marches over a relief of that kind, which must outlive it.
MarchPlan plan_marches(const Relief& relief, const StopToken& stop);

}  // namespace selenograph::engine
