#include "engine/indirect/relief.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/parallel.h"

namespace selenograph::engine {

Eigen::Matrix3d relief_axes(const Vec3& centre) {
  const EastNorthUp local = local_axes(centre);
  Eigen::Matrix3d axes;
  axes.row(0) = local.east;
  axes.row(1) = local.north;
  axes.row(2) = local.up;
  return axes;
}

Vec3 Relief::direction(std::size_t grid, std::size_t post, bool cell_middle) const {
  const Grid& g = grids_[grid];
  const auto side = static_cast<std::size_t>(g.side);
  const std::size_t row = post / side, column = post % side;
  const double offset = cell_middle ? 0.5 : 0;  // in posts
  const double x_m = g.coordinate_m(static_cast<double>(column) + offset),
               y_m = g.coordinate_m(static_cast<double>(row) + offset);
  return axes_.transpose() * Vec3(x_m, y_m, kMoonRadius_m).normalized();
}

Relief::Relief(const ReliefShape& shape, const ReliefHeights& heights, const StopToken& stop)
    : shape_(shape), axes_(relief_axes(shape.centre)) {
  // End each grid where marches from the farthest point read the next one: from where a step spans kPostsPerStep posts
  // of twice the spacing. Two more posts per side are a margin for interpolation.
  for (double spacing_m = shape.spacing_m;; spacing_m *= 2) {
    const double reach_m = std::min(2.0 * kPostsPerStep * kStepsPerDistance * spacing_m, shape.farthest_m);
    const int half_posts = static_cast<int>(std::ceil((shape.half_m + reach_m) / spacing_m)) + 2;
    Grid& grid = grids_.emplace_back(Grid{.side = 2 * half_posts + 1, .spacing_m = spacing_m, .heights = {}});
    grid.heights.resize(grid.posts() + kPadding);
    if (reach_m >= shape.farthest_m) break;
  }
  // Fill a grid batch by batch: directions take six times the memory of heights.
  constexpr std::size_t kBatch = 1 << 16, kPiece = 4096;
  std::vector<Vec3> directions;
  for (std::size_t g = 0; g < grids_.size(); ++g) {
    Grid& grid = grids_[g];
    for (std::size_t begin = 0; begin < grid.posts(); begin += kBatch) {
      directions.resize(std::min(kBatch, grid.posts() - begin));
      in_parallel_pieces(directions.size(), kPiece, [&](std::size_t first, std::size_t past_last) {
        stop.check();
        for (std::size_t i = first; i < past_last; ++i) directions[i] = direction(g, begin + i);
      });
      heights(grid.spacing_m, directions, std::span(grid.heights).subspan(begin, directions.size()));
    }
  }
  const Grid& finest = grids_.front();
  // Heights are kept relative to the middle post's: so float resolves them finely near the points that gather light.
  const float middle_height_m = finest.heights[finest.posts() / 2];
  reference_m_ = std::isnan(middle_height_m) ? 0 : static_cast<double>(middle_height_m);
  in_parallel(grids_.size(), [&](std::size_t g) {
    Grid& grid = grids_[g];
    for (float& h : std::span(grid.heights).first(grid.posts())) {
      h -= static_cast<float>(reference_m_);
      grid.highest_m = h > grid.highest_m ? h : grid.highest_m;
    }
  });
}

std::vector<GridView> Relief::views() const {
  std::vector<GridView> views;
  for (const Grid& grid : grids_)
    views.push_back({.heights = grid.heights.data(),
                     .light = nullptr,
                     .first_m = static_cast<float>(grid.coordinate_m(0)),
                     .spacing_m = static_cast<float>(grid.spacing_m),
                     .posts_per_m = static_cast<float>(1 / grid.spacing_m),
                     .coarser = static_cast<float>(1 << views.size()),
                     .side = grid.side,
                     .highest_m = -std::numeric_limits<float>::infinity()});
  // A view's greatest height includes the coarser grids, which follow it: go from the coarsest to the finest.
  float highest_m = -std::numeric_limits<float>::infinity();
  for (std::size_t g = grids_.size(); g-- > 0;) {
    highest_m = std::max(highest_m, grids_[g].highest_m);
    views[g].highest_m = highest_m;
  }
  return views;
}

Vec3 Relief::position_of(const Grid& grid, int row, int column) const {
  const auto post =
      static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.side) + static_cast<std::size_t>(column);
  const Vec3 plane(grid.coordinate_m(column), grid.coordinate_m(row), kMoonRadius_m);
  return plane * ((kMoonRadius_m + reference_m_ + static_cast<double>(grid.heights[post])) / plane.norm());
}

Relief::Cell Relief::cell(std::size_t grid, std::size_t post) const {
  const Grid& g = grids_[grid];
  const int row = static_cast<int>(post / static_cast<std::size_t>(g.side)),
            column = static_cast<int>(post % static_cast<std::size_t>(g.side));
  if (row + 1 >= g.side || column + 1 >= g.side) return {std::nanf(""), Eigen::Vector3f::Zero()};
  const Vec3 south_west = position_of(g, row, column), south_east = position_of(g, row, column + 1);
  const Vec3 north_west = position_of(g, row + 1, column), north_east = position_of(g, row + 1, column + 1);
  const Vec3 normal = (north_east - south_west).cross(north_west - south_east);  // of the diagonals; points up
  const double length = normal.norm();
  if (!(length > 0)) return {std::nanf(""), Eigen::Vector3f::Zero()};
  const auto side = static_cast<std::size_t>(g.side);
  const float* h = &g.heights[post];
  return {(h[0] + h[1] + h[side] + h[side + 1]) / 4, (normal / length).cast<float>()};
}

MarchLanes Relief::march_lanes(int row, int column, int stride) const {
  const Grid& g = grids_.front();
  MarchLanes lanes;
  lanes.y = static_cast<float>(g.coordinate_m(row));
  for (int i = 0; i < kPacket; ++i) {
    const int lane_column = column + i * stride;
    lanes.x[i] = static_cast<float>(g.coordinate_m(lane_column));
    lanes.height[i] = g.heights[static_cast<std::size_t>(row) * static_cast<std::size_t>(g.side) +
                                static_cast<std::size_t>(lane_column)];
  }
  return lanes;
}

std::size_t Relief::bytes() const {
  std::size_t sum = 0;
  for (const Grid& grid : grids_) sum += grid.heights.capacity() * sizeof(float);
  return sum;
}

}  // namespace selenograph::engine
