#include "dem/grid/post_grid.h"

#include <bit>
#include <cmath>
#include <cstdint>

namespace selenograph::dem {

std::optional<int> lattice_level_of(const GeographicGrid& g, int posts_along) {
  constexpr double kTolerance = 1e-9;  // of a post: rounding of labels' decimals in double, far below what shows
  const double ppd = std::round(g.lat_posts_per_degree);
  if (ppd < 1 || ppd > 1 << 24 || !std::has_single_bit(static_cast<std::uint32_t>(ppd))) return std::nullopt;
  // A resolution that is a little wrong adds up along the raster.
  for (const double p : {g.lat_posts_per_degree, g.lon_posts_per_degree})
    if (std::abs(p / ppd - 1) * posts_along > kTolerance) return std::nullopt;
  for (const double first : {g.first_lat_deg, g.first_lon_deg})
    if (std::abs(first * ppd - std::round(first * ppd)) > kTolerance) return std::nullopt;
  return std::countr_zero(static_cast<std::uint32_t>(ppd));
}

// Forward, Snyder (1987) 21-5, 21-6, 21-9, 21-10 on the sphere.
PostXY locate(const PolarGrid& g, double lat_deg, double lon_deg) {
  const double colatitude = (90 - (g.north ? lat_deg : -lat_deg)) * kRadiansPerDegree;
  const double rho_m = 2 * kMoonRadius_m * g.scale * std::tan(colatitude / 2);
  const double turn = (lon_deg - g.central_lon_deg) * kRadiansPerDegree;
  const double x_m = rho_m * std::sin(turn);
  const double y_m = (g.north ? -1 : 1) * rho_m * std::cos(turn);
  return {(x_m - g.first_x_m) / g.spacing_m, (g.first_y_m - y_m) / g.spacing_m};
}

// Inverse, Snyder (1987) 21-15 and 20-16 on the sphere.
Geographic place_on(const PolarGrid& g, double x_m, double y_m) {
  const double colatitude = 2 * std::atan(std::hypot(x_m, y_m) / (2 * kMoonRadius_m * g.scale)) / kRadiansPerDegree;
  const double turn = std::atan2(x_m, g.north ? -y_m : y_m) / kRadiansPerDegree;
  return {g.north ? 90 - colatitude : colatitude - 90, wrap_lon_deg(g.central_lon_deg + turn), 0};
}

}  // namespace selenograph::dem
