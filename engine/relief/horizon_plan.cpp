#include "engine/relief/horizon_plan.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/parallel.h"

namespace selenograph::engine {
namespace {

// Sets each element of `out` to the largest of the 2 radius + 1 values around it, `stride` apart, of `count` values.
void take_highest_around(const float* values, int count, std::size_t stride, int radius, float* out) {
  for (int i = 0; i < count; ++i) {
    float highest = -std::numeric_limits<float>::infinity();
    for (int j = std::max(0, i - radius); j <= std::min(count - 1, i + radius); ++j)
      highest = std::max(highest, values[static_cast<std::size_t>(j) * stride]);
    out[static_cast<std::size_t>(i) * stride] = highest;
  }
}

// Highest posts of square cells, 1 << cell_log2 posts wide, including the posts on all their borders.
struct Cells {
  std::vector<float> highest;
  int side;
};

Cells cells_of_posts(const ReliefGrid& grid) {
  Cells cells{{}, grid.side / 2 + 1};
  const auto side = static_cast<std::size_t>(cells.side), pitch = static_cast<std::size_t>(grid.pitch);
  cells.highest.resize(side * side);
  in_parallel_pieces(side, 16, [&](std::size_t first, std::size_t past_last) {
    std::vector<float> of_rows(pitch);  // highest post of the cells' rows, at each post of a row
    for (std::size_t j = first; j < past_last; ++j) {
      std::fill(of_rows.begin(), of_rows.end(), kVoidHeight_m);
      for (std::size_t r = 2 * j; r <= std::min(2 * j + 2, static_cast<std::size_t>(grid.side) - 1); ++r) {
        const float* row = &grid.heights[r * pitch];
        for (std::size_t i = 0; i < pitch; ++i) of_rows[i] = std::max(of_rows[i], row[i]);
      }
      for (int i = 0; i < cells.side; ++i) {
        float highest = kVoidHeight_m;
        for (int c = 2 * i; c <= std::min(2 * i + 2, grid.side - 1); ++c)
          highest = std::max(highest, of_rows[static_cast<std::size_t>(grid.index(c, 0))]);
        cells.highest[j * side + static_cast<std::size_t>(i)] = highest;
      }
    }
  });
  return cells;
}

Cells twice_as_large(const Cells& small) {
  Cells cells{{}, (small.side + 1) / 2};
  const auto side = static_cast<std::size_t>(cells.side), small_side = static_cast<std::size_t>(small.side);
  cells.highest.resize(side * side);
  for (std::size_t j = 0; j < side; ++j)
    for (std::size_t i = 0; i < side; ++i) {
      float highest = kVoidHeight_m;
      for (std::size_t r = 2 * j; r < std::min(2 * j + 2, small_side); ++r)
        for (std::size_t c = 2 * i; c < std::min(2 * i + 2, small_side); ++c)
          highest = std::max(highest, small.highest[r * small_side + c]);
      cells.highest[j * side + i] = highest;
    }
  return cells;
}

HighestPosts highest_around(const Cells& cells, int cell_log2, int radius) {
  HighestPosts table{std::vector<float>(cells.highest.size()), cells.side, cell_log2, radius};
  std::vector<float> along_rows(cells.highest.size());
  const auto side = static_cast<std::size_t>(cells.side);
  in_parallel_pieces(side, 16, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t j = first; j < past_last; ++j)
      take_highest_around(&cells.highest[j * side], cells.side, 1, radius, &along_rows[j * side]);
  });
  // Take the largest of whole rows: the compiler vectorises the loop over columns.
  in_parallel_pieces(side, 16, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t j = first; j < past_last; ++j) {
      float* out = &table.heights[j * side];
      std::fill(out, out + side, kVoidHeight_m);
      const auto reach = static_cast<std::size_t>(radius);
      for (std::size_t r = j > reach ? j - reach : 0; r <= std::min(side - 1, j + reach); ++r) {
        const float* row = &along_rows[r * side];
        for (std::size_t i = 0; i < side; ++i) out[i] = std::max(out[i], row[i]);
      }
    }
  });
  return table;
}

// Returns the tables of a grid, by increasing reach: 6, 8, 10, 12, 16, 20 .. posts.
std::vector<HighestPosts> tables_of(const ReliefGrid& grid, const StopToken& stop) {
  std::vector<HighestPosts> tables;
  constexpr int kMinCells = 16;  // smaller tables would bound nothing
  int cell_log2 = 1;
  for (Cells cells = cells_of_posts(grid); cells.side >= kMinCells; cells = twice_as_large(cells)) {
    stop.check();
    for (const int radius : {3, 4, 5}) tables.push_back(highest_around(cells, cell_log2, radius));
    ++cell_log2;
  }
  return tables;
}

// Adds samples, segments and their parts to a plan.
class PlanWriter {
 public:
  PlanWriter(const Relief& relief, MarchPlan& plan)
      : reference_radius_m_(relief.reference_radius_m()), farthest_m_(relief.shape().farthest_m), plan_(plan) {}

  // Adds the samples next to the place: half a post apart up to kFine_posts, then a post.
  void add_near(const ReliefGrid& grid) {
    constexpr double kFine_posts = 8, kNear_posts = 20;
    for (double posts = 0.5; posts < kNear_posts && posts * grid.spacing_m < farthest_m_;
         posts += posts < kFine_posts ? 0.5 : 1)
      add_sample(posts * grid.spacing_m);
    plan_.near_samples = static_cast<int>(plan_.samples.size());
    next_m_ = kNear_posts * grid.spacing_m;
  }

  // Adds segments up to the end of a grid's distances.
  void add_segments(const ReliefGrid& grid, int index) {
    while (next_m_ < grid.to_m) {
      constexpr double kSegmentShare = 1.0 / 8, kMinSegment_posts = 4;  // length over distance
      const double length_m = std::max(next_m_ * kSegmentShare, kMinSegment_posts * grid.spacing_m);
      add_segment(grid, index, std::min(next_m_ + length_m, grid.to_m));
    }
  }

 private:
  void add_sample(double distance_m) {
    const double angle = distance_m / kMoonRadius_m;
    plan_.samples.push_back({static_cast<float>(kMoonRadius_m * std::tan(angle)), static_cast<float>(std::tan(angle)),
                             static_cast<float>(1 / (reference_radius_m_ * std::sin(angle))),
                             static_cast<float>(std::tan(angle / 2))});
  }

  // Adds one segment from next_m_ to end_m, cut into parts if it is long.
  void add_segment(const ReliefGrid& grid, int index, double end_m) {
    constexpr int kPart = 8;  // samples of a part
    const int first = static_cast<int>(plan_.samples.size()), first_part = static_cast<int>(plan_.parts.size());
    const double begin_m = next_m_;
    for (; next_m_ < end_m; next_m_ += grid.spacing_m) add_sample(next_m_);
    const int past_last = static_cast<int>(plan_.samples.size());
    MarchSegment segment = bounded(index, first, past_last, begin_m, next_m_);
    if (past_last - first > 2 * kPart)
      for (int begin = first; begin < past_last; begin += kPart) {
        const int end = std::min(begin + kPart, past_last);
        plan_.parts.push_back(bounded(index, begin, end, begin_m + (begin - first) * grid.spacing_m,
                                      begin_m + (end - first) * grid.spacing_m));
      }
    segment.first_part = first_part;
    segment.past_last_part = static_cast<int>(plan_.parts.size());
    plan_.segments.push_back(segment);
  }

  // Returns a segment without parts. Its last sample is a post before its end.
  MarchSegment bounded(int grid, int first, int past_last, double begin_m, double end_m) const {
    const double begin = kMoonRadius_m * std::tan(begin_m / kMoonRadius_m);
    const double end = kMoonRadius_m * std::tan(end_m / kMoonRadius_m), middle = (begin + end) / 2;
    return {.grid = grid,
            .first = first,
            .past_last = past_last,
            .first_part = 0,
            .past_last_part = 0,
            .middle_m = static_cast<float>(middle),
            .tan_middle = static_cast<float>(middle / kMoonRadius_m),
            .half_m = static_cast<float>((end - begin) / 2),
            .far_m = static_cast<float>(end),
            .near_rise_per_m = static_cast<float>(1 / (reference_radius_m_ * std::sin(begin_m / kMoonRadius_m))),
            .far_rise_per_m = static_cast<float>(1 / (reference_radius_m_ * std::sin(end_m / kMoonRadius_m))),
            .near_drop = static_cast<float>(std::tan(begin_m / kMoonRadius_m / 2))};
  }

  double reference_radius_m_, farthest_m_;
  MarchPlan& plan_;
  double next_m_ = 0;
};

}  // namespace

MarchPlan plan_marches(const Relief& relief, const StopToken& stop) {
  MarchPlan plan;
  plan.grids = relief.grids();
  plan.per_radius = static_cast<float>(1 / relief.reference_radius_m());
  plan.radius_ratio = static_cast<float>(kMoonRadius_m / relief.reference_radius_m());
  PlanWriter writer(relief, plan);
  writer.add_near(plan.grids.front());
  for (std::size_t g = 0; g < plan.grids.size(); ++g) {
    plan.highest.push_back(tables_of(plan.grids[g], stop));
    writer.add_segments(plan.grids[g], static_cast<int>(g));
  }
  return plan;
}

}  // namespace selenograph::engine
