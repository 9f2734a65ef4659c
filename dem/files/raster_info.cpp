#include "dem/files/raster_info.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <variant>

#include "dem/base/error.h"
#include "dem/grid/lattice.h"

namespace selenograph::dem {
namespace {

// Limits of a file's grid. A grid beyond them is a mistake or an attack, and numbers of posts computed from it would
// overflow every integer type.
constexpr double kMinPerDegree = 1.0 / 30, kMaxPerDegree = 1 << 20;  // posts 900 km to 3 cm apart
constexpr double kMaxPostAspect = 100;                               // ratio of a post's longer side to its shorter one
constexpr int kMaxPosts = 1 << 24;         // posts along a side: the whole Moon has as many at 0.65 m
constexpr double kMaxLongitude_deg = 1e4;  // a few turns are allowed; a double is then precise to far below a post
constexpr double kFarthestFromOrigin_deg = 135;   // limit of a stereographic raster
constexpr double kFarthestFromCylinder_deg = 87;  // limit of a Mercator raster, where its scale is 19

void check_size(const RasterInfo& info) {
  if (std::max(info.width, info.height) > kMaxPosts)
    throw DataError(info.path,
                    fmt::format("has {} x {} posts, more than {} along a side", info.width, info.height, kMaxPosts));
}

// Throws DataError for an impossible number of posts per degree. Comparisons with NaN are false, so NaN throws, too.
void check_spacing(const RasterInfo& info, double per_degree) {
  if (!(per_degree >= kMinPerDegree && per_degree <= kMaxPerDegree))
    throw DataError(info.path, fmt::format("has impossible posts: {:.6g} a degree, where {:.6g} to {:.6g} are possible",
                                           per_degree, kMinPerDegree, kMaxPerDegree));
}

void check_grid(const RasterInfo& info, const GeographicGrid& g) {
  check_spacing(info, g.lat_posts_per_degree);
  check_spacing(info, g.lon_posts_per_degree);
  const double longer = g.lat_posts_per_degree / g.lon_posts_per_degree;
  if (std::max(longer, 1 / longer) > kMaxPostAspect)
    throw DataError(info.path, fmt::format("has impossible posts: {:.6g} a degree of latitude and {:.6g} of longitude",
                                           g.lat_posts_per_degree, g.lon_posts_per_degree));
  if (!(std::abs(g.first_lon_deg) <= kMaxLongitude_deg))
    throw DataError(info.path, fmt::format("begins at an impossible longitude: {:.6g} degrees", g.first_lon_deg));
}

// Returns the limits of a plane's x and y from its origin, m.
MapPoint farthest_of(const MapPlane& plane) {
  const double radius_m = kMoonRadius_m * plane.scale;
  // Cylindrical projections: along the cylinder's axis, and around it.
  const double along_m = radius_m * std::atanh(std::sin(kFarthestFromCylinder_deg * kRadiansPerDegree));
  const double around_m = 2 * std::numbers::pi * radius_m;
  switch (plane.projection) {
    case MapProjection::stereographic: {
      const double m = 2 * radius_m * std::tan(kFarthestFromOrigin_deg / 2 * kRadiansPerDegree);
      return {m, m};
    }
    case MapProjection::orthographic:
      return {2 * kMoonRadius_m, 2 * kMoonRadius_m};
    case MapProjection::mercator:
      return {around_m, along_m};
    case MapProjection::transverse_mercator:
      return {along_m, around_m};
    case MapProjection::equirectangular:
      break;  // is a GeographicGrid
  }
  return {};
}

void check_grid(const RasterInfo& info, const PlaneGrid& g) {
  const MapPlane& plane = g.plane;
  if (!(plane.scale > 0))
    throw DataError(info.path, fmt::format("has an impossible scale of its projection: {:.6g}", plane.scale));
  if (!(std::abs(plane.lat_deg) <= 90 && std::abs(plane.lon_deg) <= kMaxLongitude_deg))
    throw DataError(info.path, fmt::format("has an impossible origin of its projection: {:.6g}, {:.6g} degrees",
                                           plane.lat_deg, plane.lon_deg));
  const MapPoint farthest = farthest_of(plane);
  const double east_m = g.first_x_m + (info.width - 1) * g.spacing_m;
  const double south_m = g.first_y_m - (info.height - 1) * g.spacing_m;
  const auto check_reach = [&](double m, double max_m) {
    if (!(std::abs(m) <= max_m))
      throw DataError(info.path, fmt::format("reaches {:.6g} m from the origin of its projection, where {:.6g} m are "
                                             "possible",
                                             std::abs(m), max_m));
  };
  for (const double m : {g.first_x_m, east_m}) check_reach(m, farthest.x_m);
  for (const double m : {g.first_y_m, south_m}) check_reach(m, farthest.y_m);
  check_spacing(info, PlanePosts(g, info.width, info.height).posts_per_degree());
  if (plane.projection == MapProjection::orthographic &&
      !(std::hypot(std::clamp(0.0, g.first_x_m, east_m), std::clamp(0.0, south_m, g.first_y_m)) < kMoonRadius_m))
    throw DataError(info.path, "lies beyond the limb of its orthographic projection");
}

// Sets the number of distinct columns and `wraps_longitude`: a product that repeats its first meridian (0 and 360)
// loses the copy.
void resolve_columns(RasterInfo& info, GeographicGrid& g) {
  constexpr double kRounding = 0.05;  // tolerance in posts: pixel sizes in metres are printed rounded
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

// Sets grid, footprint and spacing of a file in degrees. Rounds the first post to the lattice if it lies on one.
void set_geographic(RasterInfo& info, GeographicGrid g) {
  resolve_columns(info, g);
  info.lattice_level = lattice_level_of(g, std::max(info.width, info.height));
  if (info.lattice_level) {
    const double ppd = std::ldexp(1.0, *info.lattice_level);
    g = {std::round(g.first_lat_deg * ppd) / ppd, std::round(g.first_lon_deg * ppd) / ppd, ppd, ppd};
  }
  const double south = g.first_lat_deg - (info.height - 1) / g.lat_posts_per_degree;
  const double slack = 0.05 / g.lat_posts_per_degree;  // rounding in labels, degrees
  if (!(g.first_lat_deg <= 90 + slack && south >= -90 - slack)) throw DataError(info.path, "has rows beyond a pole");
  g.first_lon_deg = wrap_lon_deg(g.first_lon_deg);
  const double across = info.wraps_longitude ? 360 : (info.width - 1) / g.lon_posts_per_degree;
  info.posts_per_degree = g.lat_posts_per_degree;
  info.post_spacing_m = kMetresPerDegree / g.lat_posts_per_degree;
  // Move a row within the slack beyond a pole onto the pole.
  const auto on_sphere = [](double lat_deg) { return std::clamp(lat_deg, -90.0, 90.0); };
  info.footprint = {on_sphere(south), on_sphere(g.first_lat_deg), g.first_lon_deg, g.first_lon_deg + across};
  g.first_lat_deg = info.footprint.north_deg;
  info.grid = g;
}

// Returns the column and row of a position. Columns of a raster that wraps lie in [0, width); of others, on the turn
// around the globe that is nearest to the raster's middle.
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

// Sets grid, footprint and spacing of a file on a projection's plane.
void set_plane(RasterInfo& info, PlaneGrid g) {
  g.plane.lon_deg = wrap_lon_deg(g.plane.lon_deg);
  const PlanePosts posts(g, info.width, info.height);
  info.posts_per_degree = posts.posts_per_degree();
  info.post_spacing_m = kMetresPerDegree / info.posts_per_degree;
  info.footprint = posts.footprint();
  info.grid = g;
}

}  // namespace

void set_grid(RasterInfo& info, const PostGrid& grid) {
  check_size(info);
  std::visit([&](const auto& g) { check_grid(info, g); }, grid);
  if (const auto* g = std::get_if<GeographicGrid>(&grid)) set_geographic(info, *g);
  if (const auto* g = std::get_if<PlaneGrid>(&grid)) set_plane(info, *g);
}

const char* name_of(Projection projection) {
  switch (projection) {
    case Projection::geographic:
      return "geographic";
    case Projection::polar_stereographic:
      return "polar_stereographic";
    case Projection::stereographic:
      return "stereographic";
    case Projection::orthographic:
      return "orthographic";
    case Projection::mercator:
      return "mercator";
    case Projection::transverse_mercator:
      return "transverse_mercator";
  }
  return "";
}

Projection RasterInfo::projection() const {
  const auto* g = std::get_if<PlaneGrid>(&grid);
  if (!g) return Projection::geographic;
  switch (g->plane.projection) {
    case MapProjection::stereographic:
      return std::abs(g->plane.lat_deg) == 90 ? Projection::polar_stereographic : Projection::stereographic;
    case MapProjection::orthographic:
      return Projection::orthographic;
    case MapProjection::mercator:
      return Projection::mercator;
    case MapProjection::transverse_mercator:
      return Projection::transverse_mercator;
    case MapProjection::equirectangular:
      break;
  }
  return Projection::geographic;
}

int level_needed(const RasterInfo& info) {
  if (info.lattice_level) return std::clamp(*info.lattice_level, 0, kMaxLevel);
  const double octaves = std::log2(info.posts_per_degree);
  // Posts of 2^n px/deg that are not vertices of level n lie half a pixel off (pixel is area): they are vertices of the
  // next level.
  const bool half_pixel = info.projection() == Projection::geographic && std::abs(octaves - std::round(octaves)) < 1e-9;
  return std::clamp(static_cast<int>(std::ceil(octaves - 1e-9)) + (half_pixel ? 1 : 0), 0, kMaxLevel);
}

PostXY locate(const RasterInfo& info, double lat_deg, double lon_deg) {
  if (const auto* g = std::get_if<PlaneGrid>(&info.grid))
    return PlanePosts(*g, info.width, info.height).locate(lat_deg, lon_deg);
  return locate_geographic(std::get<GeographicGrid>(info.grid), info, lat_deg, lon_deg);
}

Geographic place_of_post(const RasterInfo& info, int x, int y) {
  if (const auto* g = std::get_if<PlaneGrid>(&info.grid)) return PlanePosts(*g, info.width, info.height).position(x, y);
  const auto& g = std::get<GeographicGrid>(info.grid);
  return {g.first_lat_deg - y / g.lat_posts_per_degree, wrap_lon_deg(g.first_lon_deg + x / g.lon_posts_per_degree), 0};
}

}  // namespace selenograph::dem
