#include "engine/horizons/horizon_relief.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/parallel.h"

namespace selenograph::engine {
namespace {

// Size of a grid, and the distances along the sphere that it serves.
struct GridShape {
  int side;
  double spacing_m, from_m, to_m;
  double middle() const { return (side - 1) / 2.0; }
};

std::vector<GridShape> grids_of(const HorizonReliefShape& shape) {
  std::vector<GridShape> grids;
  double from_m = 0;
  for (double spacing_m = shape.spacing_m; from_m < shape.farthest_m; spacing_m *= 2) {
    const double to_m = std::min(kPostsPerDistance * spacing_m, shape.farthest_m);
    const double tangent = std::tan(to_m / kMoonRadius_m), offset = shape.half_m * std::sqrt(2.0) / kMoonRadius_m;
    // A place off the centre moves along the plane by more than R tan(a): see MarchPlaces.
    const double reach_m = kMoonRadius_m * tangent * (1 + 2 * offset * tangent + 2 * offset * offset);
    constexpr int kMargin_posts = 4;
    const int half_posts = static_cast<int>(std::ceil((shape.half_m + reach_m) / spacing_m)) + kMargin_posts;
    grids.push_back({2 * half_posts + 1, spacing_m, from_m, to_m});
    from_m = to_m;
  }
  return grids;
}

// Fills a grid with heights above the datum, row by row from the south-west.
std::vector<float> read_heights(const GridShape& grid, const Eigen::Matrix3d& axes, const ReliefHeights& heights,
                                const StopToken& stop) {
  const auto side = static_cast<std::size_t>(grid.side);
  std::vector<float> values(side * side);
  // Read in batches: directions take six times the memory of heights.
  constexpr std::size_t kBatch = 1 << 18, kPiece = 4096;
  std::vector<Vec3> directions;
  for (std::size_t begin = 0; begin < values.size(); begin += kBatch) {
    directions.resize(std::min(kBatch, values.size() - begin));
    in_parallel_pieces(directions.size(), kPiece, [&](std::size_t first, std::size_t past_last) {
      stop.check();
      for (std::size_t i = first; i < past_last; ++i) {
        const std::size_t row = (begin + i) / side, column = (begin + i) % side;
        const double x_m = (static_cast<double>(column) - grid.middle()) * grid.spacing_m;
        const double y_m = (static_cast<double>(row) - grid.middle()) * grid.spacing_m;
        directions[i] = axes.transpose() * Vec3(x_m, y_m, kMoonRadius_m).normalized();
      }
    });
    heights(grid.spacing_m, directions, std::span(values).subspan(begin, directions.size()));
  }
  return values;
}

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

Cells cells_of_posts(const std::vector<float>& heights, int grid_side) {
  Cells cells{{}, grid_side / 2 + 1};
  const auto side = static_cast<std::size_t>(cells.side);
  cells.highest.resize(side * side);
  in_parallel_pieces(side, 16, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t j = first; j < past_last; ++j)
      for (std::size_t i = 0; i < side; ++i) {
        float highest = kVoidHeight_m;
        for (std::size_t r = 2 * j; r <= std::min(2 * j + 2, static_cast<std::size_t>(grid_side) - 1); ++r)
          for (std::size_t c = 2 * i; c <= std::min(2 * i + 2, static_cast<std::size_t>(grid_side) - 1); ++c)
            highest = std::max(highest, heights[r * static_cast<std::size_t>(grid_side) + c]);
        cells.highest[j * side + i] = highest;
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
std::vector<HighestPosts> tables_of(const std::vector<float>& heights, int grid_side, const StopToken& stop) {
  std::vector<HighestPosts> tables;
  constexpr int kMinCells = 16;  // smaller tables would bound nothing
  int cell_log2 = 1;
  for (Cells cells = cells_of_posts(heights, grid_side); cells.side >= kMinCells; cells = twice_as_large(cells)) {
    stop.check();
    for (const int radius : {3, 4, 5}) tables.push_back(highest_around(cells, cell_log2, radius));
    ++cell_log2;
  }
  return tables;
}

// Adds samples, segments and their parts to a plan.
class PlanWriter {
 public:
  PlanWriter(double reference_m, double farthest_m, MarchPlan& plan)
      : reference_radius_m_(kMoonRadius_m + reference_m), farthest_m_(farthest_m), plan_(plan) {}

  // Adds the samples next to the place: half a post apart up to kFine_posts, then a post.
  void add_near(const GridShape& grid) {
    constexpr double kFine_posts = 8, kNear_posts = 20;
    for (double posts = 0.5; posts < kNear_posts && posts * grid.spacing_m < farthest_m_;
         posts += posts < kFine_posts ? 0.5 : 1)
      add_sample(posts * grid.spacing_m);
    plan_.near_samples = static_cast<int>(plan_.samples.size());
    next_m_ = kNear_posts * grid.spacing_m;
  }

  // Adds segments up to the end of a grid's distances.
  void add_segments(const GridShape& grid, int index) {
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
  void add_segment(const GridShape& grid, int index, double end_m) {
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

// Arranges the columns of a grid for a lattice, see MarchGrid. Returns the posts of a run.
int arrange_columns(int grid_side, int columns_log2, std::vector<float>& heights) {
  const int run = (grid_side >> columns_log2) + 1, last_remainder = (1 << columns_log2) - 1;
  const auto side = static_cast<std::size_t>(grid_side), pitch = static_cast<std::size_t>(run) << columns_log2;
  std::vector<float> arranged(side * pitch, kVoidHeight_m);
  in_parallel_pieces(side, 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t r = first; r < past_last; ++r)
      for (int c = 0; c < grid_side; ++c) {
        const int to = (c & last_remainder) * run + (c >> columns_log2);
        arranged[r * pitch + static_cast<std::size_t>(to)] = heights[r * side + static_cast<std::size_t>(c)];
      }
  });
  heights = std::move(arranged);
  return run;
}

}  // namespace

double posts_of(const HorizonReliefShape& shape) {
  double sum = 0;
  for (const GridShape& grid : grids_of(shape)) sum += static_cast<double>(grid.side) * grid.side;
  return sum;
}

Eigen::Matrix3d axes_of(const HorizonReliefShape& shape) {
  const Eigen::Matrix3d axes = relief_axes(shape.centre);
  const double cosine = std::cos(shape.turn_rad), sine = std::sin(shape.turn_rad);
  Eigen::Matrix3d turned = axes;
  turned.row(0) = cosine * axes.row(0) + sine * axes.row(1);
  turned.row(1) = cosine * axes.row(1) - sine * axes.row(0);
  return turned;
}

HorizonRelief::HorizonRelief(const HorizonReliefShape& shape, const ReliefHeights& heights, const StopToken& stop)
    : shape_(shape), axes_(axes_of(shape)) {
  const std::vector<GridShape> grids = grids_of(shape);
  for (const GridShape& grid : grids) heights_.push_back(read_heights(grid, axes_, heights, stop));
  // Keep heights relative to the middle post's: so float resolves them to millimetres near the places.
  const float middle_height_m = heights_.front()[heights_.front().size() / 2];
  reference_m_ = std::isnan(middle_height_m) ? 0 : static_cast<double>(middle_height_m);
  plan_.per_radius = static_cast<float>(1 / (kMoonRadius_m + reference_m_));
  plan_.radius_ratio = static_cast<float>(kMoonRadius_m / (kMoonRadius_m + reference_m_));
  PlanWriter writer(reference_m_, shape.farthest_m, plan_);
  writer.add_near(grids.front());
  for (std::size_t g = 0; g < grids.size(); ++g) {
    float highest_m = kVoidHeight_m;
    for (float& height_m : heights_[g]) {
      height_m = std::isnan(height_m) ? kVoidHeight_m : height_m - static_cast<float>(reference_m_);
      highest_m = std::max(highest_m, height_m);
    }
    plan_.highest.push_back(tables_of(heights_[g], grids[g].side, stop));
    const int columns_log2 = shape.lattice_log2 - static_cast<int>(g);
    const bool has_lattice = columns_log2 >= 0;
    const int run = has_lattice ? arrange_columns(grids[g].side, columns_log2, heights_[g]) : 0;
    plan_.grids.push_back({.heights = heights_[g].data(),
                           .side = grids[g].side,
                           .has_lattice = has_lattice,
                           .columns_log2 = std::max(columns_log2, 0),
                           .run = run,
                           .pitch = has_lattice ? run << columns_log2 : grids[g].side,
                           .middle = static_cast<float>(grids[g].middle()),
                           .posts_per_m = static_cast<float>(1 / grids[g].spacing_m),
                           .highest_m = highest_m});
    writer.add_segments(grids[g], static_cast<int>(g));
  }
}

std::optional<double> HorizonRelief::height_m(double x_m, double y_m) const {
  const MarchGrid& grid = plan_.grids.front();
  const double column = x_m / shape_.spacing_m + static_cast<double>(grid.middle);
  const double row = y_m / shape_.spacing_m + static_cast<double>(grid.middle);
  const int i = static_cast<int>(column), j = static_cast<int>(row);
  const auto post = [&](int column_index, int row_index) {
    return static_cast<double>(grid.heights[grid.index(column_index, row_index)]);
  };
  const double corners[4] = {post(i, j), post(i + 1, j), post(i, j + 1), post(i + 1, j + 1)};
  constexpr double kVoid_m = kVoidHeight_m;
  if (std::any_of(std::begin(corners), std::end(corners), [](double h) { return h <= kVoid_m; })) return std::nullopt;
  const double east = column - i, north = row - j;
  const double south_m = corners[0] + east * (corners[1] - corners[0]);
  const double north_m = corners[2] + east * (corners[3] - corners[2]);
  return reference_m_ + south_m + north * (north_m - south_m);
}

std::size_t HorizonRelief::bytes() const {
  std::size_t sum = 0;
  for (const std::vector<float>& heights : heights_) sum += heights.size() * sizeof(float);
  for (const auto& tables : plan_.highest)
    for (const HighestPosts& table : tables) sum += table.heights.size() * sizeof(float);
  return sum;
}

}  // namespace selenograph::engine
