#include "tests/support/closed_forms.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "dem/gdal/geotiff_writer.h"
#include "engine/radiometry/photometry.h"

namespace selenograph::test {
namespace {

ClosedForm bowl(double diameter_over_depth) {
  constexpr double kRadius = 0.5, kInside = 0.95;  // the posts round off the rim
  const double depth = 1 / diameter_over_depth, sphere = (kRadius * kRadius + depth * depth) / (2 * depth);
  // The bowl's share of the whole sphere is what each place sees of it.
  const double share = depth / (2 * sphere);
  return {.name = fmt::format("bowl-{:g}", diameter_over_depth),
          .suns_deg = {2, 5, 10, 20, 40},
          .sun_azimuth_deg = 70,
          .half_north = ClosedForm::kHalfEast,
          .height = [=](double r) { return r > kRadius ? 0 : sphere - depth - std::sqrt(sphere * sphere - r * r); },
          .is_round = true,
          .light =
              [=](double east, double north, double sun_elevation_deg, double albedo) {
                if (std::hypot(east, north) > kInside * kRadius) return std::numeric_limits<double>::quiet_NaN();
                return std::sin(sun_elevation_deg * kRadiansPerDegree) * albedo * share * (1 - share);
              }};
}

// A place x from the walls' common edge sees the other wall, L wide, from its own wall's line to the direction of the
// upper edge: the view factor is (1 + (L cos a - x) / sqrt(x^2 + L^2 - 2 x L cos a)) / 2, a: angle between the walls.
ClosedForm trench(double slope_deg, double sun_deg) {
  constexpr double kHalfWidth = 0.5, kFrom = 0.04, kTo = 0.48;  // the posts round off the edges
  const double slope = std::tan(slope_deg * kRadiansPerDegree), stretch = std::hypot(1, slope);
  const double cosine = std::cos((180 - 2 * slope_deg) * kRadiansPerDegree), wall = kHalfWidth * stretch;
  return {.name = fmt::format("trench-{:g}", slope_deg),
          .suns_deg = {sun_deg},
          .sun_azimuth_deg = 90,
          .half_north = 20,
          .height = [=](double east) { return -slope * std::max(kHalfWidth - std::abs(east), 0.0); },
          .is_round = false,
          .light =
              [=](double east, double, double sun_elevation_deg, double albedo) {
                if (std::abs(east) < kFrom || std::abs(east) > kTo) return std::numeric_limits<double>::quiet_NaN();
                const double x = std::abs(east) * stretch;
                const double view =
                    (1 + (wall * cosine - x) / std::sqrt(x * x + wall * wall - 2 * x * wall * cosine)) / 2;
                // The Sun stands in the east: the wall to the west faces it.
                const double other_slope_deg = east > 0 ? slope_deg : -slope_deg;
                return std::sin((sun_elevation_deg + other_slope_deg) * kRadiansPerDegree) * albedo * view;
              }};
}

}  // namespace

std::vector<ClosedForm> bowls() { return {bowl(5), bowl(8), bowl(14)}; }

std::vector<ClosedForm> trenches() { return {trench(15, 40), trench(25, 40), trench(45, 60)}; }

void write_ground(const ClosedForm& form, int width_posts, const std::string& path) {
  const int half_columns = static_cast<int>(std::ceil(ClosedForm::kHalfEast * width_posts));
  const int half_rows = static_cast<int>(std::ceil(form.half_north * width_posts));
  constexpr double kStep_deg = 1 / kClosedFormPostsPerDegree;
  const dem::GeotiffGrid grid{.north_deg = kClosedFormCenter.lat_deg + half_rows * kStep_deg,
                              .west_deg = kClosedFormCenter.lon_deg - half_columns * kStep_deg,
                              .lat_step_deg = kStep_deg,
                              .lon_step_deg = kStep_deg,
                              .width = 2 * half_columns + 1,
                              .height = 2 * half_rows + 1};
  std::vector<float> heights_m;
  heights_m.reserve(static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height));
  for (int row = -half_rows; row <= half_rows; ++row)
    for (int column = -half_columns; column <= half_columns; ++column) {
      const double distance = form.is_round ? std::hypot(column, row) : column;
      heights_m.push_back(static_cast<float>(form.height(distance / width_posts) * width_posts * kClosedFormPosts_m));
    }
  dem::write_geotiff(path, grid, heights_m, "height");
}

double light_w_m2(const ClosedForm& form, int width_posts, const Vec3& position_m, double sun_elevation_deg,
                  double albedo) {
  const Geographic position = to_geographic(position_m);
  const double posts = kClosedFormPostsPerDegree / width_posts;
  return engine::kSolarConstant_w_m2 * form.light((position.lon_deg - kClosedFormCenter.lon_deg) * posts,
                                                  (position.lat_deg - kClosedFormCenter.lat_deg) * posts,
                                                  sun_elevation_deg, albedo);
}

}  // namespace selenograph::test
