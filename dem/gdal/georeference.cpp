#include "dem/gdal/georeference.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <optional>
#include <string_view>

#include "dem/base/error.h"
#include "dem/files/files.h"
#include "dem/files/map_sphere.h"

namespace selenograph::dem {
namespace {

constexpr std::string_view kWarpIt =
    "warp it to degrees first: gdalwarp -t_srs '+proj=longlat +R=1737400 +no_defs' -r cubic in.tif out.tif";

// Returns the radius of a coordinate system's sphere, m.
double sphere_of(const OGRSpatialReference& srs, const std::string& path) {
  const double semi_axes_m[] = {srs.GetSemiMajor(), srs.GetSemiMinor()};
  return map_sphere_m(semi_axes_m, path);
}

// First post and (positive) spacing in the units of the coordinate system. flip_x and flip_y: the raster is stored in
// the opposite direction.
struct Plane {
  double first_x = 0, first_y = 0, dx = 0, dy = 0;
  bool flip_x = false, flip_y = false;
};

// Reads the posts' positions from the geotransform: x = t[0] + column * t[1], y = t[3] + row * t[5], at pixel corners.
Plane find_plane(GDALDataset& dataset, const std::string& path) {
  double t[6];
  if (dataset.GetGeoTransform(t) != CE_None) throw DataError(path, "has no geotransform");
  if (t[2] != 0 || t[4] != 0) throw DataError(path, fmt::format("is rotated or sheared; {}", kWarpIt));
  if (!(std::isfinite(t[0]) && std::isfinite(t[3]) && std::abs(t[1]) > 0 && std::abs(t[5]) > 0))
    throw DataError(path, "has an impossible geotransform");
  const bool flip_x = t[1] < 0;
  const bool flip_y = t[5] > 0;
  // Use pixel centres, the posts: GDAL's transform is that of pixel corners whatever AREA_OR_POINT says (it shifts
  // PixelIsPoint files itself).
  const double column = flip_x ? dataset.GetRasterXSize() - 0.5 : 0.5,
               row = flip_y ? dataset.GetRasterYSize() - 0.5 : 0.5;
  return {t[0] + column * t[1], t[3] + row * t[5], std::abs(t[1]), std::abs(t[5]), flip_x, flip_y};
}

GeographicGrid grid_in_degrees(const Plane& p, double lon0_deg) {
  return {p.first_y, p.first_x + lon0_deg, 1 / p.dy, 1 / p.dx};
}

// Undoes the rounding of pixel sizes and origins in metres that were converted from degrees. If posts per degree, or
// degrees per post, are within 2e-7 of a whole number (sizes of seven digits), that number was meant. If the position
// is within 0.02 posts of a half post, that was meant, too. Without this no file in metres would wrap or fit its
// neighbour. Posts a whole number of metres apart stay where the file says: they are near half a post only by chance.
void undo_rounding(double& first_deg, double& posts_per_degree) {
  const double rounded = posts_per_degree > 1 ? std::round(posts_per_degree) : 1 / std::round(1 / posts_per_degree);
  if (!(std::abs(posts_per_degree / rounded - 1) < 2e-7)) return;
  posts_per_degree = rounded;
  const double nearest = std::round(first_deg * rounded * 2) / 2;
  if (std::abs(first_deg * rounded - nearest) < 0.02) first_deg = nearest / rounded;
}

// Returns the unit of length of a map on another sphere, scaled to the Moon's radius: maps of spheres are similar.
double unit_on_moon_m(const OGRSpatialReference& srs, double sphere_m) {
  return srs.GetLinearUnits() * (kMoonRadius_m / sphere_m);
}

// Returns the grid of an equirectangular raster: x and y in metres are proportional to longitude and latitude.
GeographicGrid grid_in_metres(const OGRSpatialReference& srs, const Plane& p, double unit_m) {
  const double lon_scale = std::cos(srs.GetNormProjParm(SRS_PP_STANDARD_PARALLEL_1, 0) * kRadiansPerDegree);
  const double lat0 = srs.GetNormProjParm(SRS_PP_LATITUDE_OF_ORIGIN, 0);
  const double lon0 = srs.GetNormProjParm(SRS_PP_CENTRAL_MERIDIAN, 0);
  const double x_m = (p.first_x - srs.GetProjParm(SRS_PP_FALSE_EASTING, 0)) * unit_m;
  const double y_m = (p.first_y - srs.GetProjParm(SRS_PP_FALSE_NORTHING, 0)) * unit_m;
  GeographicGrid g{lat0 + y_m / kMetresPerDegree, lon0 + x_m / (kMetresPerDegree * lon_scale),
                   kMetresPerDegree / (p.dy * unit_m), kMetresPerDegree * lon_scale / (p.dx * unit_m)};
  undo_rounding(g.first_lat_deg, g.lat_posts_per_degree);
  undo_rounding(g.first_lon_deg, g.lon_posts_per_degree);
  return g;
}

// Returns the plane of a projection by GDAL's name; empty if it is not supported. On the sphere double stereographic
// ("Oblique") is stereographic.
std::optional<MapPlane> plane_of(const OGRSpatialReference& srs, const std::string& projection) {
  const auto is = [&](const char* name) { return EQUAL(projection.c_str(), name); };
  const double lat_deg = srs.GetNormProjParm(SRS_PP_LATITUDE_OF_ORIGIN, 0);
  MapPlane plane;
  plane.lat_deg = lat_deg;
  plane.lon_deg = srs.GetNormProjParm(SRS_PP_CENTRAL_MERIDIAN, 0);
  plane.scale = srs.GetNormProjParm(SRS_PP_SCALE_FACTOR, 1);
  if (is(SRS_PT_POLAR_STEREOGRAPHIC)) {
    // Convert the latitude of true scale to a scale at the pole: k0 = (1 + sin lat) / 2 on the sphere (Snyder 1987,
    // 21-7).
    const double true_lat_deg = srs.GetNormProjParm(SRS_PP_LATITUDE_OF_ORIGIN, 90);
    plane.projection = MapProjection::stereographic;
    plane.lat_deg = true_lat_deg > 0 ? 90 : -90;
    plane.scale *= (1 + std::sin(std::abs(true_lat_deg) * kRadiansPerDegree)) / 2;
  } else if (is(SRS_PT_STEREOGRAPHIC) || is(SRS_PT_OBLIQUE_STEREOGRAPHIC)) {
    plane.projection = MapProjection::stereographic;
    if (std::abs(std::abs(lat_deg) - 90) < 1e-9) plane.lat_deg = std::copysign(90, lat_deg);
  } else if (is(SRS_PT_ORTHOGRAPHIC)) {
    plane.projection = MapProjection::orthographic;
    plane.scale = 1;
  } else if (is(SRS_PT_MERCATOR_1SP) || is(SRS_PT_MERCATOR_2SP)) {
    if (lat_deg != 0) return std::nullopt;
    plane.projection = MapProjection::mercator;
    plane.scale *= std::cos(srs.GetNormProjParm(SRS_PP_STANDARD_PARALLEL_1, 0) * kRadiansPerDegree);
  } else if (is(SRS_PT_TRANSVERSE_MERCATOR)) {
    plane.projection = MapProjection::transverse_mercator;
  } else {
    return std::nullopt;
  }
  return plane;
}

PlaneGrid grid_on_plane(const OGRSpatialReference& srs, const MapPlane& plane, const Plane& p, double unit_m,
                        const std::string& path) {
  if (std::abs(p.dx / p.dy - 1) > 1e-9) throw DataError(path, fmt::format("its pixels are not square; {}", kWarpIt));
  return {plane, (p.first_x - srs.GetProjParm(SRS_PP_FALSE_EASTING, 0)) * unit_m,
          (p.first_y - srs.GetProjParm(SRS_PP_FALSE_NORTHING, 0)) * unit_m, p.dx * unit_m};
}

// Converts "Mercator (Spherical)" (EPSG method 1026) to Mercator variant A, which has the same formulas on a sphere.
// PROJ before 9.3 exposes the parameters of the former only under their names in the file.
OGRSpatialReference as_variant_a(const OGRSpatialReference& spherical) {
  OGRSpatialReference srs(spherical);
  const double unit_m = srs.GetLinearUnits();
  const auto parameter = [&](const char* name) { return spherical.GetProjParm(name, 0); };
  srs.SetMercator(parameter("Latitude of natural origin"), parameter("Longitude of natural origin"), 1,
                  parameter("False easting"), parameter("False northing"));
  srs.SetLinearUnits("unit", unit_m);
  return srs;
}

// Returns the grid of a raster in its coordinate system. Throws DataError for a system that is not supported.
PostGrid grid_of(const OGRSpatialReference& srs, const Plane& plane, double sphere_m, const std::string& path) {
  const double prime_deg = srs.GetPrimeMeridian();
  if (srs.IsGeographic()) {
    if (std::abs(srs.GetAngularUnits() / kRadiansPerDegree - 1) > 1e-9) throw DataError(path, "is not in degrees");
    return grid_in_degrees(plane, prime_deg);
  }
  if (prime_deg != 0) throw DataError(path, "a projected raster with its own prime meridian is not supported");
  const char* name = srs.GetAttrValue("PROJECTION");
  const std::string projection = name ? name : "none";
  // GDAL before 3.10 replaces the space of the method's name by an underscore.
  if (EQUAL(projection.c_str(), "Mercator_(Spherical)") || EQUAL(projection.c_str(), "Mercator (Spherical)"))
    return grid_of(as_variant_a(srs), plane, sphere_m, path);
  const double unit_m = unit_on_moon_m(srs, sphere_m);
  if (EQUAL(projection.c_str(), SRS_PT_EQUIRECTANGULAR)) return grid_in_metres(srs, plane, unit_m);
  if (const std::optional<MapPlane> map_plane = plane_of(srs, projection))
    return grid_on_plane(srs, *map_plane, plane, unit_m, path);
  throw DataError(path, fmt::format("its projection '{}' is not supported; {}", projection, kWarpIt));
}

// Returns the error text for a file without a coordinate system. A .prj file next to it is named but not read: many
// programs write such files, in dialects.
std::string how_to_add_system(const std::string& path) {
  std::string neighbour;
  for (const char* extension : {".prj", ".PRJ"})
    if (std::string file = std::filesystem::path(path).replace_extension(extension).string(); file_state(file))
      neighbour = file;
  const std::string system = neighbour.empty() ? "+proj=longlat +R=1737400 +no_defs" : neighbour;
  return fmt::format(
      "has no coordinate system{}: write it into the file, e.g. gdal_translate -a_srs '{}' in.tif "
      "out.tif",
      neighbour.empty() ? "" : "; " + neighbour + " is not read", system);
}

}  // namespace

Georeference georeference_of(GDALDataset& dataset, const std::string& path) {
  const OGRSpatialReference* srs = dataset.GetSpatialRef();
  if (!srs) throw DataError(path, how_to_add_system(path));
  const double sphere_m = sphere_of(*srs, path);
  const Plane plane = find_plane(dataset, path);
  return {grid_of(*srs, plane, sphere_m, path), sphere_m, plane.flip_x, plane.flip_y};
}

}  // namespace selenograph::dem
