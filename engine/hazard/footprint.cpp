#include "engine/hazard/footprint.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace selenograph::engine {
namespace {

// Returns half the diameter, enlarged so that rounding excludes no pixel at the border.
double half_m(const LanderFootprint& footprint) { return footprint.diameter_m / 2 * (1 + 1e-9); }

// Returns true if the footprint covers a point, given by its offset (east, north) from the centre. Legs cover the disc
// around their ends.
bool covers(const LanderFootprint& footprint, const Vec2& offset_m) {
  return (footprint.shape == LanderFootprint::Shape::square ? offset_m.max_abs() : offset_m.norm()) <=
         half_m(footprint);
}

// Returns the largest offsets of a covered pixel along rows (x) and columns (y), rounded up. The matrix takes a point
// of the footprint to pixels; over a square its components are largest at a corner, over a disc at the row's direction.
Vec2 reach_along_axes_px(const LanderFootprint& footprint, const Mat2& px_per_metre) {
  const auto px = [&](const Vec2& row) {
    const double px_per_half_m =
        footprint.shape == LanderFootprint::Shape::square ? std::abs(row.x()) + std::abs(row.y()) : row.norm();
    return std::ceil(px_per_half_m * half_m(footprint));
  };
  return {px(px_per_metre.row(0)), px(px_per_metre.row(1))};
}

}  // namespace

int FootprintOnMap::reach_px() const {
  int reach = 0;
  for (const FootprintRow& r : rows) reach = std::max({reach, std::abs(r.row), -r.first, r.past_last - 1});
  for (const Vec2i& pad : pads) reach = std::max({reach, std::abs(pad.x()), std::abs(pad.y())});
  return reach;
}

std::optional<Mat2> metres_per_px(const dem::MapGrid& grid, int column, int row, double height_m) {
  const dem::MapTransform map(grid.plane);
  const auto middle = map.direction(grid.point(column, row));
  const auto left = map.direction(grid.point(column - 1, row)), right = map.direction(grid.point(column + 1, row));
  const auto above = map.direction(grid.point(column, row - 1)), below = map.direction(grid.point(column, row + 1));
  if (!middle || !left || !right || !above || !below) return std::nullopt;
  const EastNorthUp axes = local_axes(*middle);
  // Central differences on the datum, then scaled to the ground's radius.
  const Vec3 to_right_m = (*right - *left) * (kMoonRadius_m / 2), downward_m = (*below - *above) * (kMoonRadius_m / 2);
  const Mat2 on_datum({to_right_m.dot(axes.east), to_right_m.dot(axes.north)},
                      {downward_m.dot(axes.east), downward_m.dot(axes.north)});
  return (kMoonRadius_m + height_m) / kMoonRadius_m * on_datum;
}

double reach_upper_bound_px(const LanderFootprint& footprint, const Mat2& metres_per_px) {
  const Vec2 reach_px = reach_along_axes_px(footprint, metres_per_px.inverse());
  return reach_px.is_finite() ? std::max(reach_px.x(), reach_px.y()) : std::numeric_limits<double>::infinity();
}

FootprintOnMap footprint_on_map(const LanderFootprint& footprint, const Mat2& metres_per_px) {
  FootprintOnMap out{metres_per_px, {}, {}};
  const Mat2 px_per_metre = metres_per_px.inverse();
  const Vec2 reach_px = reach_along_axes_px(footprint, px_per_metre);
  const int max_x = static_cast<int>(reach_px.x()), max_y = static_cast<int>(reach_px.y());
  for (int y = -max_y; y <= max_y; ++y) {
    FootprintRow covered{.row = y, .first = max_x + 1, .past_last = -max_x};  // empty
    for (int x = -max_x; x <= max_x; ++x) {
      if (!covers(footprint, out.metres_per_px * Vec2(x, y))) continue;
      covered.first = std::min(covered.first, x);
      covered.past_last = x + 1;
    }
    if (covered.first < covered.past_last) out.rows.push_back(covered);
  }
  if (footprint.shape != LanderFootprint::Shape::legs) return out;
  for (int leg = 0; leg < footprint.legs; ++leg) {
    const double azimuth = footprint.azimuth_deg * kRadiansPerDegree + 2 * std::numbers::pi * leg / footprint.legs;
    const Vec2 offset_m = footprint.diameter_m / 2 * Vec2(std::sin(azimuth), std::cos(azimuth));
    const Vec2 pad_px = px_per_metre * offset_m;
    out.pads.emplace_back(static_cast<int>(std::round(pad_px.x())), static_cast<int>(std::round(pad_px.y())));
  }
  return out;
}

}  // namespace selenograph::engine
