#include "dem/detail/direction_grid.h"

#include <algorithm>

namespace selenograph::dem {

// Visits the grid's border only: a grid is at most a quarter of the globe wide, so its farthest position lies there.
BoundingBall ball_around(const DirectionGrid& grid) {
  const std::size_t rows = grid.rows(), columns = grid.columns();
  BoundingBall ball{grid.direction(rows / 2, columns / 2), 0};
  const auto include = [&](std::size_t r, std::size_t c) {
    ball.radius_m = std::max(ball.radius_m, (grid.direction(r, c) - ball.direction).norm() * kMoonRadius_m);
  };
  for (std::size_t r = 0; r < rows; ++r) {
    include(r, 0);
    include(r, columns - 1);
  }
  for (std::size_t c = 0; c < columns; ++c) {
    include(0, c);
    include(rows - 1, c);
  }
  return ball;
}

// A grid that extends past a pole has rows whose sines do not ascend: then returns all rows.
std::pair<std::size_t, std::size_t> rows_within(const DirectionGrid& grid, const Vec3& centre, double reach) {
  if (grid.cos_lat.front() < 0 || grid.cos_lat.back() < 0) return {0, grid.rows()};
  const auto first = std::lower_bound(grid.sin_lat.begin(), grid.sin_lat.end(), centre.z() - reach);
  const auto past = std::upper_bound(first, grid.sin_lat.end(), centre.z() + reach);
  return {first - grid.sin_lat.begin(), past - grid.sin_lat.begin()};
}

// From the right-angled triangle of the pole, the centre and the point where the circle touches a meridian, sin(half
// width) = reach / distance from the axis.
std::pair<std::size_t, std::size_t> columns_within(const DirectionGrid& grid, const Vec3& centre, double reach) {
  constexpr double kMarginFactor = 1 + 1e-6;  // covers rounding; a chord for a sine only widens the range
  const std::size_t n = grid.columns();
  const double axis_distance = std::hypot(centre.x(), centre.y()), sine = kMarginFactor * reach / axis_distance;
  if (!(sine < 1)) return {0, n};  // the circle contains the pole
  const double half_columns = std::asin(sine) / grid.lon_step, middle = static_cast<double>(n - 1) / 2;
  const double longitude = std::atan2(centre.y(), centre.x());
  // Take the turn nearest to the middle of the grid, which is narrower than a turn.
  const double centre_column =
      middle + std::remainder(longitude - (grid.west + middle * grid.lon_step), 2 * std::numbers::pi) / grid.lon_step;
  const auto clamped = [&](double column) {
    return static_cast<std::size_t>(std::clamp(column, 0.0, static_cast<double>(n)));
  };
  return {clamped(std::floor(centre_column - half_columns)), clamped(std::ceil(centre_column + half_columns) + 1)};
}

}  // namespace selenograph::dem
