// Projections against their closed forms, and against themselves.
#include "dem/grid/map_grid.h"

#include <cpl_string.h>
#include <cpl_vsi.h>
#include <gtest/gtest.h>

#include <cmath>

#include "dem/gdal/geotiff_writer.h"

namespace selenograph::dem {
namespace {

constexpr double kQuarter_m = kMoonRadius_m * std::numbers::pi / 2;

MapPlane equirectangular(double lon_deg, double standard_parallel_deg) {
  return {MapProjection::equirectangular, 0, lon_deg, standard_parallel_deg};
}
MapPlane polar(double lat_deg) { return {MapProjection::stereographic, lat_deg, 0, 0}; }
MapPlane orthographic(double lat_deg, double lon_deg) { return {MapProjection::orthographic, lat_deg, lon_deg, 0}; }
MapPlane mercator(double lon_deg, double scale) { return {MapProjection::mercator, 0, lon_deg, 0, scale}; }
MapPlane transverse(double lat_deg, double lon_deg, double scale) {
  return {MapProjection::transverse_mercator, lat_deg, lon_deg, 0, scale};
}

// Metres on the sphere between where a plane has a point and where that should be.
double off_m(const MapPlane& plane, const MapPoint& point, double lat_deg, double lon_deg) {
  const auto direction = MapTransform(plane).direction(point);
  if (!direction) return INFINITY;
  return (*direction * kMoonRadius_m - to_cartesian({lat_deg, lon_deg, 0})).norm();
}

constexpr double kClose_m = 1e-6;

TEST(MapPlane, EquirectangularIsLinearInDegrees) {
  EXPECT_LT(off_m(equirectangular(0, 0), {0, 0}, 0, 0), kClose_m);
  EXPECT_LT(off_m(equirectangular(0, 0), {kQuarter_m, kQuarter_m / 2}, 45, 90), kClose_m);
  EXPECT_LT(off_m(equirectangular(180, 0), {kMetresPerDegree, 0}, 0, -179), kClose_m);
  EXPECT_LT(off_m(equirectangular(10, 60), {kMetresPerDegree, 2 * kMetresPerDegree}, 2, 12), kClose_m);
  EXPECT_FALSE(MapTransform(equirectangular(0, 0)).direction({0, 1.001 * kQuarter_m}));
}

TEST(MapPlane, ProjectionIsInvertible) {
  for (const MapPlane& plane :
       {equirectangular(0, 0), equirectangular(180, -50), polar(90), polar(-90), orthographic(70, 100),
        orthographic(-90, 0), orthographic(90, 20), orthographic(0, -180), mercator(0, 1), mercator(-170, 0.7),
        transverse(0, 0, 1), transverse(-89, 100, 1.2), MapPlane{MapProjection::stereographic, -40, 10, 0, 0.9}})
    for (double lat = -89.5; lat < 90; lat += 12.3)
      for (double lon = -179.5; lon < 180; lon += 17.1) {
        const auto point = MapTransform(plane).project(lat, lon);
        const Vec3 up = to_cartesian({plane.lat_deg, plane.lon_deg, 0}) / kMoonRadius_m;
        const double toward = up.dot(to_cartesian({lat, lon, 0})) / kMoonRadius_m;
        if (plane.projection == MapProjection::orthographic && toward < 0.05) {
          EXPECT_TRUE(toward > -1e-9 || !point);
          continue;
        }
        ASSERT_TRUE(point);
        EXPECT_LT(off_m(plane, *point, lat, lon), 1e-5) << lat << " " << lon;
      }
}

TEST(MapPlane, PlacesOutsideTheProjection) {
  EXPECT_FALSE(MapTransform(polar(90)).project(-90, 0));
  EXPECT_FALSE(MapTransform(polar(-90)).project(90, 0));
  EXPECT_FALSE(MapTransform(orthographic(0, 0)).project(0, 91));
}

TEST(MapGrid, PixelsFromTheNorthWest) {
  const MapGrid grid{equirectangular(0, 0), 1000, 500, 10, 7, 5};
  const MapPoint first = grid.point(0, 0), last = grid.point(6, 4);
  EXPECT_EQ(first.x_m, 1005);
  EXPECT_EQ(first.y_m, 495);
  EXPECT_EQ(last.x_m, 1065);
  EXPECT_EQ(last.y_m, 455);
  EXPECT_EQ(geotransform_of(grid), (std::array<double, 6>{1000, 10, 0, 500, 0, -10}));
}

TEST(MapGrid, WktNamesProjectionAndSphere) {
  for (const auto& [plane, method] : {std::pair{equirectangular(180, 0), "METHOD[\"Equidistant Cylindrical\""},
                                      {polar(-90), "METHOD[\"Polar Stereographic (variant"},
                                      {orthographic(26, 3), "METHOD[\"Orthographic\""},
                                      {mercator(3, 1), "METHOD[\"Mercator (variant A)\""},
                                      {transverse(26, 3, 1), "METHOD[\"Transverse Mercator\""}}) {
    const std::string wkt = wkt_of(plane);
    EXPECT_NE(wkt.find(method), std::string::npos) << wkt;
    EXPECT_NE(wkt.find("ELLIPSOID[\"Moon (2015) - Sphere\",1737400,0"), std::string::npos) << wkt;
  }
}

TEST(MapGrid, StopsAtTheDeadline) {
  const MapGrid grid{equirectangular(0, 0), 0, 0, 10, 8, 8};
  const std::vector<float> values(64, 1.F);
  const MapBand band{"height", "m", values.data()};
  EXPECT_THROW(geotiff_bytes(grid, {&band, 1}, "{}", StopToken(StopToken::Clock::now())), Cancelled);
  EXPECT_LT(geotiff_bytes(grid, {&band, 1}, "{}", {}).size(), geotiff_bytes_at_most(grid, {&band, 1}));
}

// Everything that GDAL says of a map goes into the file itself, and nothing is left in memory.
TEST(MapGrid, FailedWriteLeavesNoFile) {
  const std::vector<float> values(64, 1.F);
  const MapBand band{"height", "m", values.data()};
  for (const MapPlane& plane : {equirectangular(180, 0), equirectangular(10, 60), polar(90), orthographic(26, 3)})
    geotiff_bytes({plane, 0, 0, 10, 8, 8}, {&band, 1}, "{}", {});
  const CPLStringList left(VSIReadDirRecursive("/vsimem/"));
  for (int i = 0; i < left.Count(); ++i) EXPECT_EQ(std::string(left[i]).find(".tif"), std::string::npos) << left[i];
}

}  // namespace
}  // namespace selenograph::dem
