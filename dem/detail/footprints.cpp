#include "dem/detail/footprints.h"

#include <algorithm>
#include <cmath>

#include "dem/detail/size_cells.h"

namespace selenograph::dem {

Footprint footprint_of(const BlockId& id) {
  const BlockExtent e = extent_of(id);
  return {lat_deg_of(e.lat0), lat_deg_of(e.lat1()), lon_deg_of(e.lon0), lon_deg_of(e.lon1())};
}

double area_m2(const Footprint& f) {
  return kMoonRadius_m * kMoonRadius_m * (f.east_deg - f.west_deg) * kRadiansPerDegree *
         (std::sin(f.north_deg * kRadiansPerDegree) - std::sin(f.south_deg * kRadiansPerDegree));
}

bool holds(const Footprint& f, const Geographic& g) {
  const double east = g.lon_deg + 360 * std::ceil((f.west_deg - g.lon_deg) / 360);
  return g.lat_deg >= f.south_deg && g.lat_deg <= f.north_deg && east <= f.east_deg;
}

std::optional<Footprint> common(const Footprint& a, const Footprint& b) {
  // Shift b by whole turns to the first copy that ends east of the western border of a.
  const double turns_deg = 360 * std::ceil((a.west_deg - b.east_deg) / 360);
  const Footprint both{std::max(a.south_deg, b.south_deg), std::min(a.north_deg, b.north_deg),
                       std::max(a.west_deg, b.west_deg + turns_deg), std::min(a.east_deg, b.east_deg + turns_deg)};
  if (both.south_deg > both.north_deg || both.west_deg > both.east_deg) return std::nullopt;
  return both;
}

Circle circle_around(const Footprint& f) {
  const auto direction = [](double lat_deg, double lon_deg) -> Vec3 {
    return to_cartesian({lat_deg, lon_deg, 0}) / kMoonRadius_m;
  };
  const Vec3 middle = direction((f.south_deg + f.north_deg) / 2, (f.west_deg + f.east_deg) / 2);
  // Corners are the farthest points. The eastern ones are as far as the western ones.
  return {middle, kMoonRadius_m * std::max((direction(f.south_deg, f.west_deg) - middle).norm(),
                                           (direction(f.north_deg, f.west_deg) - middle).norm())};
}

// Cuts the region into rows of equal height, and each row into boxes about as wide as high.
std::vector<Footprint> cut(const Footprint& region, double side_m, const StopToken& stop) {
  constexpr std::size_t kBoxesPerCheck = 4096;
  std::vector<Footprint> boxes;
  const double side_deg = side_m / kMetresPerDegree;
  const auto steps = [&](double length_deg) { return std::max(1, static_cast<int>(std::ceil(length_deg / side_deg))); };
  // Returns border i of n equal parts; the last one without rounding.
  const auto part_border = [](double low, double high, int i, int n) {
    return i == n ? high : low + (high - low) * i / n;
  };
  const int rows = steps(region.north_deg - region.south_deg);
  for (int r = 0; r < rows; ++r) {
    Footprint box = region;
    box.south_deg = part_border(region.south_deg, region.north_deg, r, rows);
    box.north_deg = part_border(region.south_deg, region.north_deg, r + 1, rows);
    const double equatorward_deg = box.south_deg > 0 ? box.south_deg : std::max(0.0, -box.north_deg);
    const int columns = steps((region.east_deg - region.west_deg) * std::cos(equatorward_deg * kRadiansPerDegree));
    for (int c = 0; c < columns; ++c) {
      if (boxes.size() % kBoxesPerCheck == 0) stop.check();
      box.west_deg = part_border(region.west_deg, region.east_deg, c, columns);
      box.east_deg = part_border(region.west_deg, region.east_deg, c + 1, columns);
      boxes.push_back(box);
    }
  }
  return boxes;
}

// Returns all longitudes for a box that reaches a pole or runs around the globe.
Footprint around(const Footprint& f, double margin_m) {
  const double angle = margin_m / kMoonRadius_m, margin_deg = angle * kDegreesPerRadian;
  Footprint wide{std::max(-90.0, f.south_deg - margin_deg), std::min(90.0, f.north_deg + margin_deg), -180, 180};
  const double min_cos_lat = std::cos(std::max(-wide.south_deg, wide.north_deg) * kRadiansPerDegree);
  if (wide.south_deg <= -90 || wide.north_deg >= 90 || std::sin(angle) >= min_cos_lat) return wide;
  // A cap of this angular radius reaches farthest in longitude where it touches a meridian.
  const double lon_margin_deg = std::asin(std::sin(angle) / min_cos_lat) * kDegreesPerRadian;
  if (f.east_deg - f.west_deg + 2 * lon_margin_deg >= 360) return wide;
  wide.west_deg = f.west_deg - lon_margin_deg;
  wide.east_deg = f.east_deg + lon_margin_deg;
  return wide;
}

double cells_of(int smallest_octave, int largest_octave, const Footprint& region, double smallest_m) {
  // Treat the region as a rectangle with a margin of one cell on each side.
  const double height_m = (region.north_deg - region.south_deg) * kMetresPerDegree,
               width_m = area_m2(region) / height_m;
  double cells = 0;
  for (int k = std::max(smallest_octave, octave_of(smallest_m)); k <= largest_octave; ++k) {
    const double side_m = std::ldexp(SizeCells::kCellDiameters, k);
    cells += (height_m / side_m + 2) * (width_m / side_m + 2);
  }
  return cells;
}

}  // namespace selenograph::dem
