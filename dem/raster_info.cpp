#include "dem/raster_info.h"

#include <algorithm>
#include <cmath>

#include "dem/error.h"

namespace selenograph::dem {
namespace {

// Width of the columns that differ; a product that repeats its first meridian (0 and 360) loses the copy.
void settle_columns(RasterInfo& info, GeographicGrid& g) {
  constexpr double kRounding = 0.05;  // of a post; pixel sizes in metres are printed rounded
  const double circle = 360 * g.lon_posts_per_degree;
  if (info.width < circle - kRounding) return;
  if (std::abs(circle - std::round(circle)) > kRounding) {
    if (info.width - 1 <= circle) return;
    throw DataError(info.path, "covers more than 360 degrees of longitude");
  }
  info.width = static_cast<int>(std::lround(circle));
  info.wraps_longitude = true;
  g.lon_posts_per_degree = info.width / 360.0;
}

void set_geographic(RasterInfo& info, GeographicGrid g) {
  settle_columns(info, g);
  info.lattice_level = lattice_level_of(g, std::max(info.width, info.height));
  if (info.lattice_level) {
    const double ppd = std::ldexp(1.0, *info.lattice_level);
    g = {std::round(g.first_lat_deg * ppd) / ppd, std::round(g.first_lon_deg * ppd) / ppd, ppd, ppd};
  }
  const double south = g.first_lat_deg - (info.height - 1) / g.lat_posts_per_degree;
  const double slack = 0.05 / g.lat_posts_per_degree;
  if (!(g.first_lat_deg <= 90 + slack && south >= -90 - slack)) throw DataError(info.path, "has rows beyond a pole");
  g.first_lon_deg = wrap_lon_deg(g.first_lon_deg);
  const double across = info.wraps_longitude ? 360 : (info.width - 1) / g.lon_posts_per_degree;
  info.posts_per_degree = g.lat_posts_per_degree;
  info.post_spacing_m = kMetresPerDegree / g.lat_posts_per_degree;
  // A row within the slack beyond a pole lies on it.
  const auto on_sphere = [](double lat_deg) { return std::clamp(lat_deg, -90.0, 90.0); };
  info.footprint = {on_sphere(south), on_sphere(g.first_lat_deg), g.first_lon_deg, g.first_lon_deg + across};
  g.first_lat_deg = info.footprint.north_deg;
  info.grid = g;
}

PostXY locate_geographic(const GeographicGrid& g, const RasterInfo& info, double lat_deg, double lon_deg) {
  PostXY p{0, (g.first_lat_deg - lat_deg) * g.lat_posts_per_degree};
  if (info.wraps_longitude) {
    const double turns = std::floor((lon_deg - g.first_lon_deg) / 360);
    p.x = (lon_deg - g.first_lon_deg - 360 * turns) * g.lon_posts_per_degree;
    if (p.x >= info.width) p.x -= info.width;
    p.x = std::max(p.x, 0.0);
  } else {
    const double middle = (info.footprint.west_deg + info.footprint.east_deg) / 2;
    const double turns = std::round((lon_deg - middle) / 360);
    p.x = (lon_deg - 360 * turns - g.first_lon_deg) * g.lon_posts_per_degree;
  }
  return p;
}

// Where the longitudes of a rectangle that leaves the pole out begin and end: at corners, since it is convex.
void longitudes_of(const PolarGrid& g, double east_m, double south_m, Footprint& f) {
  const double middle = place_on(g, (g.first_x_m + east_m) / 2, (g.first_y_m + south_m) / 2).lon_deg;
  double low = 0, high = 0;
  for (const double x : {g.first_x_m, east_m})
    for (const double y : {g.first_y_m, south_m}) {
      const double away = std::remainder(place_on(g, x, y).lon_deg - middle, 360);
      low = std::min(low, away);
      high = std::max(high, away);
    }
  f.west_deg = wrap_lon_deg(middle + low);
  f.east_deg = f.west_deg + (high - low);
}

Footprint footprint_of(const PolarGrid& g, int width, int height) {
  const double east_m = g.first_x_m + (width - 1) * g.spacing_m;
  const double south_m = g.first_y_m - (height - 1) * g.spacing_m;
  const double far_x = std::max(std::abs(g.first_x_m), std::abs(east_m));
  const double far_y = std::max(std::abs(g.first_y_m), std::abs(south_m));
  const double near_x = std::clamp(0.0, g.first_x_m, east_m), near_y = std::clamp(0.0, south_m, g.first_y_m);
  const double far_lat = place_on(g, far_x, far_y).lat_deg, near_lat = place_on(g, near_x, near_y).lat_deg;
  Footprint f{std::min(far_lat, near_lat), std::max(far_lat, near_lat), -180, 180};
  if (near_x != 0 || near_y != 0) longitudes_of(g, east_m, south_m, f);
  return f;
}

void set_polar(RasterInfo& info, const PolarGrid& g) {
  info.posts_per_degree = kMetresPerDegree * g.scale / g.spacing_m;
  info.post_spacing_m = g.spacing_m / g.scale;
  info.footprint = footprint_of(g, info.width, info.height);
  info.grid = g;
}

}  // namespace

void set_grid(RasterInfo& info, const PostGrid& grid) {
  if (const auto* g = std::get_if<GeographicGrid>(&grid)) set_geographic(info, *g);
  if (const auto* g = std::get_if<PolarGrid>(&grid)) set_polar(info, *g);
}

PostXY locate(const RasterInfo& info, double lat_deg, double lon_deg) {
  if (const auto* g = std::get_if<PolarGrid>(&info.grid)) return locate(*g, lat_deg, lon_deg);
  return locate_geographic(std::get<GeographicGrid>(info.grid), info, lat_deg, lon_deg);
}

Geographic place_of_post(const RasterInfo& info, int x, int y) {
  if (const auto* g = std::get_if<PolarGrid>(&info.grid))
    return place_on(*g, g->first_x_m + x * g->spacing_m, g->first_y_m - y * g->spacing_m);
  const auto& g = std::get<GeographicGrid>(info.grid);
  return {g.first_lat_deg - y / g.lat_posts_per_degree, wrap_lon_deg(g.first_lon_deg + x / g.lon_posts_per_degree), 0};
}

}  // namespace selenograph::dem
