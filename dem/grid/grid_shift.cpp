#include "dem/grid/grid_shift.h"

#include <cmath>

namespace selenograph::dem {

std::optional<std::pair<std::int64_t, std::int64_t>> shift_between(const PostGrid& grid, const PostGrid& shifted) {
  constexpr double kTolerance = 1e-3;  // share of the post spacing
  const auto same = [](double a, double b) { return std::abs(a / b - 1) <= 1e-9; };
  double dx = 0, dy = 0;  // columns east and rows south from the first post of `grid` to that of `shifted`
  if (grid.index() != shifted.index()) return std::nullopt;
  if (const auto* plane_grid = std::get_if<PlaneGrid>(&grid)) {
    const auto& b = std::get<PlaneGrid>(shifted);
    if (plane_grid->plane != b.plane || !same(plane_grid->spacing_m, b.spacing_m)) return std::nullopt;
    dx = (b.first_x_m - plane_grid->first_x_m) / plane_grid->spacing_m;
    dy = (plane_grid->first_y_m - b.first_y_m) / plane_grid->spacing_m;
  } else {
    const auto& a = std::get<GeographicGrid>(grid);
    const auto& b = std::get<GeographicGrid>(shifted);
    if (!same(a.lat_posts_per_degree, b.lat_posts_per_degree) || !same(a.lon_posts_per_degree, b.lon_posts_per_degree))
      return std::nullopt;
    dx = (b.first_lon_deg - a.first_lon_deg) * a.lon_posts_per_degree;
    dy = (a.first_lat_deg - b.first_lat_deg) * a.lat_posts_per_degree;
  }
  if (std::abs(dx - std::round(dx)) > kTolerance || std::abs(dy - std::round(dy)) > kTolerance) return std::nullopt;
  return std::pair{std::llround(dx), std::llround(dy)};
}

}  // namespace selenograph::dem
