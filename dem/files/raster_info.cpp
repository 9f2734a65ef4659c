#include "dem/files/raster_info.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <variant>

#include "dem/grid/lattice.h"
#include "dem/support/error.h"

namespace selenograph::dem {
namespace {

// What a file may say of its grid. Whatever is beyond these is a mistake or an attack, and numbers of posts made from
// it would not be whole numbers of any type.
constexpr double kFewestPerDegree = 1.0 / 30, kMostPerDegree = kTicksPerDegree;  // posts 900 km to 3 cm apart
constexpr double kLongestPosts = 100;            // a post's width by its height, or the other way round
constexpr int kMostPosts = 1 << 24;              // along a side: the whole Moon has as many at 0.65 m
constexpr double kFarthestLongitude_deg = 1e4;   // after some turns; precise to far below a post
constexpr double kFarthestColatitude_deg = 135;  // of a polar raster

void check_size(const RasterInfo& info) {
  if (std::max(info.width, info.height) > kMostPosts)
    throw DataError(info.path,
                    fmt::format("has {} x {} posts, more than {} along a side", info.width, info.height, kMostPosts));
}

// Comparisons with NaN are false.
void check_spacing(const RasterInfo& info, double per_degree) {
  if (!(per_degree >= kFewestPerDegree && per_degree <= kMostPerDegree))
    throw DataError(info.path, fmt::format("has impossible posts: {:.6g} a degree, where {:.6g} to {:.6g} are possible",
                                           per_degree, kFewestPerDegree, kMostPerDegree));
}

void check_grid(const RasterInfo& info, const GeographicGrid& g) {
  check_spacing(info, g.lat_posts_per_degree);
  check_spacing(info, g.lon_posts_per_degree);
  const double longer = g.lat_posts_per_degree / g.lon_posts_per_degree;
  if (std::max(longer, 1 / longer) > kLongestPosts)
    throw DataError(info.path, fmt::format("has impossible posts: {:.6g} a degree of latitude and {:.6g} of longitude",
                                           g.lat_posts_per_degree, g.lon_posts_per_degree));
  if (!(std::abs(g.first_lon_deg) <= kFarthestLongitude_deg))
    throw DataError(info.path, fmt::format("begins at an impossible longitude: {:.6g} degrees", g.first_lon_deg));
}

void check_grid(const RasterInfo& info, const PolarGrid& g) {
  if (!(g.scale > 0)) throw DataError(info.path, fmt::format("has an impossible scale at its pole: {:.6g}", g.scale));
  check_spacing(info, kMetresPerDegree * g.scale / g.spacing_m);
  if (!(std::abs(g.central_lon_deg) <= kFarthestLongitude_deg))
    throw DataError(info.path, fmt::format("has an impossible central longitude: {:.6g} degrees", g.central_lon_deg));
  const double farthest_m = 2 * kMoonRadius_m * g.scale * std::tan(kFarthestColatitude_deg / 2 * kRadiansPerDegree);
  const double east_m = g.first_x_m + (info.width - 1) * g.spacing_m;
  const double south_m = g.first_y_m - (info.height - 1) * g.spacing_m;
  for (const double m : {g.first_x_m, g.first_y_m, east_m, south_m})
    if (!(std::abs(m) <= farthest_m))
      throw DataError(info.path, fmt::format("reaches {:.6g} m from its pole, farther than {:.0f} degrees", std::abs(m),
                                             kFarthestColatitude_deg));
}

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
  check_size(info);
  std::visit([&](const auto& g) { check_grid(info, g); }, grid);
  if (const auto* g = std::get_if<GeographicGrid>(&grid)) set_geographic(info, *g);
  if (const auto* g = std::get_if<PolarGrid>(&grid)) set_polar(info, *g);
}

int level_needed(const RasterInfo& info) {
  if (info.lattice_level) return std::clamp(*info.lattice_level, 0, kMaxLevel);
  const double octaves = std::log2(info.posts_per_degree);
  // 2^n px/deg that are not vertices of level n lie half a pixel off (pixel is area): they are vertices of the next
  // level.
  const bool half_pixel = info.projection() == Projection::geographic && std::abs(octaves - std::round(octaves)) < 1e-9;
  return std::clamp(static_cast<int>(std::ceil(octaves - 1e-9)) + (half_pixel ? 1 : 0), 0, kMaxLevel);
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
