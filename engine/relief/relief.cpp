#include "engine/relief/relief.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dem/base/parallel.h"

namespace selenograph::engine {
namespace {

// Returns the grids of a relief, without heights.
std::vector<ReliefGrid> empty_grids(const ReliefShape& shape) {
  std::vector<ReliefGrid> grids;
  double to_m = 0;
  for (double spacing_m = shape.spacing_m; to_m < shape.farthest_m; spacing_m *= 2) {
    to_m = std::min(shape.posts_per_distance * spacing_m, shape.farthest_m);
    const double tangent = std::tan(to_m / kMoonRadius_m), offset = shape.half_m * std::sqrt(2.0) / kMoonRadius_m;
    // A place off the centre moves along the plane by more than R tan(a): see MarchPlaces.
    const double reach_m = kMoonRadius_m * tangent * (1 + 2 * offset * tangent + 2 * offset * offset);
    constexpr int kMargin_posts = 4;
    const int half_posts = static_cast<int>(std::ceil((shape.half_m + reach_m) / spacing_m)) + kMargin_posts;
    ReliefGrid& grid = grids.emplace_back();
    grid.side = grid.pitch = 2 * half_posts + 1;
    grid.spacing_m = spacing_m;
    grid.to_m = to_m;
    grid.middle = static_cast<float>(half_posts);
    grid.posts_per_m = static_cast<float>(1 / spacing_m);
    grid.coarser = static_cast<float>(spacing_m / shape.spacing_m);
  }
  return grids;
}

Mat3 turned_axes(const ReliefShape& shape) {
  const Mat3 axes = relief_axes(shape.centre);
  const double cosine = std::cos(shape.turn_rad), sine = std::sin(shape.turn_rad);
  return Mat3::from_rows(cosine * axes.row(0) + sine * axes.row(1), cosine * axes.row(1) - sine * axes.row(0),
                         axes.row(2));
}

std::size_t posts_of(const ReliefGrid& grid) {
  return static_cast<std::size_t>(grid.side) * static_cast<std::size_t>(grid.side);
}

}  // namespace

Mat3 relief_axes(const Vec3& centre) {
  const EastNorthUp local = local_axes(centre);
  return Mat3::from_rows(local.east, local.north, local.up);
}

double post_count(const ReliefShape& shape) {
  double sum = 0;
  for (const ReliefGrid& grid : empty_grids(shape)) sum += static_cast<double>(posts_of(grid));
  return sum;
}

Relief::Relief(const ReliefShape& shape, const ReliefHeights& heights, const StopToken& stop)
    : shape_(shape), axes_(turned_axes(shape)), grids_(empty_grids(shape)) {
  for (std::size_t g = 0; g < grids_.size(); ++g) read_heights(g, heights, stop);
  // Heights are kept relative to the middle post's: so float resolves them finely near the places.
  const float middle_height_m = grids_.front().heights[posts_of(grids_.front()) / 2];
  reference_m_ = std::isnan(middle_height_m) ? 0 : static_cast<double>(middle_height_m);
  for (std::size_t g = grids_.size(); g-- > 0;) {
    if (g + 1 < grids_.size()) grids_[g].highest_m = grids_[g + 1].highest_m;
    finish(g);
  }
}

void Relief::read_heights(std::size_t grid_index, const ReliefHeights& heights, const StopToken& stop) {
  ReliefGrid& grid = grids_[grid_index];
  const std::size_t posts = posts_of(grid);
  grid.heights.resize(posts + kPadding);
  // Read in batches: directions take six times the memory of heights.
  constexpr std::size_t kBatch = 1 << 18, kPiece = 4096;
  std::vector<Vec3> directions;
  for (std::size_t begin = 0; begin < posts; begin += kBatch) {
    directions.resize(std::min(kBatch, posts - begin));
    in_parallel_pieces(directions.size(), kPiece, [&](std::size_t first, std::size_t past_last) {
      stop.check();
      for (std::size_t i = first; i < past_last; ++i) directions[i] = direction(grid_index, begin + i);
    });
    heights(grid.spacing_m, directions, std::span(grid.heights).subspan(begin, directions.size()));
  }
}

void Relief::finish(std::size_t grid_index) {
  ReliefGrid& grid = grids_[grid_index];
  const auto reference_m = static_cast<float>(reference_m_);
  float highest_m = grid.highest_m;
  for (float& height_m : std::span(grid.heights).first(posts_of(grid))) {
    height_m = std::isnan(height_m) ? shape_.void_height_m : height_m - reference_m;
    highest_m = height_m > highest_m ? height_m : highest_m;
  }
  grid.highest_m = highest_m;
  const int columns_log2 = shape_.lattice_log2 - static_cast<int>(grid_index);
  grid.has_lattice = columns_log2 >= 0;
  if (!grid.has_lattice) return;
  grid.columns_log2 = columns_log2;
  grid.run = (grid.side >> columns_log2) + 1;
  grid.pitch = grid.run << columns_log2;
  std::vector<float> arranged(static_cast<std::size_t>(grid.side) * static_cast<std::size_t>(grid.pitch) + kPadding,
                              shape_.void_height_m);
  const auto side = static_cast<std::size_t>(grid.side), pitch = static_cast<std::size_t>(grid.pitch);
  const std::size_t run = static_cast<std::size_t>(grid.run), step = std::size_t{1} << columns_log2;
  in_parallel_pieces(side, 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t row = first; row < past_last; ++row)
      for (std::size_t remainder = 0; remainder < step; ++remainder) {
        float* out = &arranged[row * pitch + remainder * run];
        for (std::size_t column = remainder; column < side; column += step) *out++ = grid.heights[row * side + column];
      }
  });
  grid.heights = std::move(arranged);
}

Vec3 Relief::direction(std::size_t grid_index, std::size_t post, bool cell_middle) const {
  const ReliefGrid& grid = grids_[grid_index];
  const auto side = static_cast<std::size_t>(grid.side);
  const std::size_t row = post / side, column = post % side;
  const double offset = cell_middle ? 0.5 : 0;  // in posts
  const double x_m = grid.coordinate_m(static_cast<double>(column) + offset),
               y_m = grid.coordinate_m(static_cast<double>(row) + offset);
  return axes_.transpose_times(Vec3(x_m, y_m, kMoonRadius_m).normalized());
}

Vec3 Relief::position_of(const ReliefGrid& grid, int row, int column) const {
  const Vec3 plane(grid.coordinate_m(column), grid.coordinate_m(row), kMoonRadius_m);
  const auto height_m = static_cast<double>(grid.heights[static_cast<std::size_t>(grid.index(column, row))]);
  return plane * ((reference_radius_m() + height_m) / plane.norm());
}

Relief::Cell Relief::cell(std::size_t grid_index, std::size_t post) const {
  const ReliefGrid& grid = grids_[grid_index];
  const auto side = static_cast<std::size_t>(grid.side);
  const int row = static_cast<int>(post / side), column = static_cast<int>(post % side);
  if (row + 1 >= grid.side || column + 1 >= grid.side) return {std::nanf(""), Vec3f::zero()};
  const Vec3 south_west = position_of(grid, row, column), south_east = position_of(grid, row, column + 1);
  const Vec3 north_west = position_of(grid, row + 1, column), north_east = position_of(grid, row + 1, column + 1);
  const Vec3 normal = (north_east - south_west).cross(north_west - south_east);  // of the diagonals; points up
  const double length = normal.norm();
  if (!(length > 0)) return {std::nanf(""), Vec3f::zero()};
  const float* h = &grid.heights[post];
  return {(h[0] + h[1] + h[side] + h[side + 1]) / 4, (normal / length).cast<float>()};
}

std::optional<double> Relief::height_m(double x_m, double y_m) const {
  const ReliefGrid& grid = grids_.front();
  const double column = x_m / grid.spacing_m + static_cast<double>(grid.middle);
  const double row = y_m / grid.spacing_m + static_cast<double>(grid.middle);
  const int i = static_cast<int>(column), j = static_cast<int>(row);
  double corners[4];
  for (int k = 0; k < 4; ++k) {
    const float corner_m = grid.heights[static_cast<std::size_t>(grid.index(i + k % 2, j + k / 2))];
    if (std::isnan(corner_m) || corner_m == shape_.void_height_m) return std::nullopt;
    corners[k] = static_cast<double>(corner_m);
  }
  const double south_m = corners[0] + (column - i) * (corners[1] - corners[0]);
  const double north_m = corners[2] + (column - i) * (corners[3] - corners[2]);
  return reference_m_ + south_m + (row - j) * (north_m - south_m);
}

std::size_t Relief::bytes() const {
  std::size_t sum = 0;
  for (const ReliefGrid& grid : grids_) sum += grid.heights.capacity() * sizeof(float);
  return sum;
}

}  // namespace selenograph::engine
