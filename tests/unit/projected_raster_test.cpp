// GeoTIFFs on the plane of a projection: where posts lie, against GDAL and closed forms; footprints; what is refused;
// what resampling costs; maps that are written and read back.
#include <fmt/format.h>
#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <vector>

#include "dem/base/error.h"
#include "dem/catalogue/catalogue.h"
#include "dem/gdal/geotiff_writer.h"
#include "dem/gdal/library.h"
#include "dem/gdal/raster.h"
#include "dem/posts/layer_joins.h"
#include "dem/posts/post_source.h"
#include "dem/terrain/resampling.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

OGRSpatialReference reference_of(const std::string& definition) {
  OGRSpatialReference srs;
  EXPECT_EQ(srs.SetFromUserInput(definition.c_str()), OGRERR_NONE) << definition;
  srs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return srs;
}

// From the plane of a definition to degrees.
class GdalPlane {
 public:
  explicit GdalPlane(const std::string& definition)
      : from_(reference_of(definition)), to_(reference_of("+proj=longlat +R=1737400 +no_defs")) {
    transform_.reset(OGRCreateCoordinateTransformation(&from_, &to_));
  }
  Geographic place(double x, double y) const {
    if (!transform_->Transform(1, &x, &y)) return {NAN, NAN, 0};
    return {y, x, 0};
  }

 private:
  OGRSpatialReference from_, to_;
  std::unique_ptr<OGRCoordinateTransformation> transform_;
};

struct PlaneTiff {
  std::string srs;
  // In the SRS' unit; rotation in rows and columns.
  double west = 0, north = 0, dx = 100, dy = -100, rotation = 0;
  int width = 40, height = 30;
  std::vector<float> posts = {};  // 100 * row + column where empty
};

double distance_m(const Geographic& a, const Geographic& b) { return (to_cartesian(a) - to_cartesian(b)).norm(); }

class ProjectedRaster : public ::testing::Test {
 protected:
  std::string put(const PlaneTiff& t, const std::string& name = "p.tif") const {
    GDALAllRegister();
    const std::string path = folder_ / name;
    const DatasetPtr file(GetGDALDriverManager()->GetDriverByName("GTiff")->Create(path.c_str(), t.width, t.height, 1,
                                                                                   GDT_Float32, nullptr));
    double transform[6] = {t.west, t.dx, t.rotation, t.north, t.rotation, t.dy};
    file->SetGeoTransform(transform);
    const OGRSpatialReference srs = reference_of(t.srs);
    file->SetSpatialRef(&srs);
    std::vector<float> posts = t.posts;
    for (int i = static_cast<int>(posts.size()); i < t.width * t.height; ++i)
      posts.push_back(static_cast<float>(100 * (i / t.width) + i % t.width));
    EXPECT_EQ(file->GetRasterBand(1)->RasterIO(GF_Write, 0, 0, t.width, t.height, posts.data(), t.width, t.height,
                                               GDT_Float32, 0, 0, nullptr),
              CE_None);
    return path;
  }
  // With the heights of a function, which are NaN beyond a limb.
  std::string put(PlaneTiff t, const test::HeightFunction& height_m, const std::string& name = "p.tif") const {
    const QuietGdal quiet;  // of what is beyond the limb
    const GdalPlane plane(t.srs);
    for (int row = 0; row < t.height; ++row)
      for (int column = 0; column < t.width; ++column) {
        const Geographic g = plane.place(t.west + (column + 0.5) * t.dx, t.north + (row + 0.5) * t.dy);
        t.posts.push_back(std::isfinite(g.lat_deg) ? static_cast<float>(height_m(g.lat_deg, g.lon_deg)) : NAN);
      }
    return put(t, name);
  }
  std::string refusal(const PlaneTiff& t) const {
    try {
      inspect_raster(put(t));
    } catch (const DataError& error) {
      return error.what();
    }
    return {};
  }

  test::TemporaryFolder folder_;
};

float post_of(Raster& raster, int x, int y) {
  float height_m = 0;
  raster.read(x, y, 1, 1, &height_m);
  return height_m;
}

struct Named {
  const char* srs;
  Projection projection;
};
constexpr Named kPlanes[] = {
    {"+proj=ortho +lat_0=26.1 +lon_0=3.6", Projection::orthographic},
    {"+proj=ortho +lat_0=-90 +lon_0=20", Projection::orthographic},
    {"+proj=ortho +lat_0=90 +lon_0=-160", Projection::orthographic},
    {"+proj=ortho +lat_0=-50 +lon_0=180 +x_0=12000 +y_0=-7000", Projection::orthographic},
    {"+proj=stere +lat_0=-43 +lon_0=-11.2", Projection::stereographic},
    {"+proj=stere +lat_0=60 +lon_0=-179.9 +k_0=0.98 +x_0=500 +y_0=2000", Projection::stereographic},
    {"+proj=sterea +lat_0=12 +lon_0=100 +k_0=0.9999", Projection::stereographic},
    {"+proj=stere +lat_0=90 +lon_0=135 +k_0=0.97 +x_0=500 +y_0=2000", Projection::polar_stereographic},
    {"+proj=merc +lon_0=70", Projection::mercator},
    {"+proj=merc +lon_0=180 +lat_ts=40 +x_0=300 +y_0=-100", Projection::mercator},
    {"+proj=merc +lon_0=-30 +k_0=0.9", Projection::mercator},
    {"+proj=tmerc +lat_0=0 +lon_0=9 +k_0=0.9996 +x_0=50000 +y_0=10000", Projection::transverse_mercator},
    {"+proj=tmerc +lat_0=-80 +lon_0=179", Projection::transverse_mercator},
};
struct UnitOfLength {
  const char* proj;
  double metres;
};
constexpr UnitOfLength kUnits[] = {{"m", 1}, {"km", 1000}, {"us-ft", 1200.0 / 3937}};

TEST_F(ProjectedRaster, PostsLieWhereGdalPlacesThem) {
  for (const Named& named : kPlanes)
    for (const UnitOfLength& unit : kUnits) {
      PlaneTiff t;
      t.srs = std::string(named.srs) + " +R=1737400 +no_defs +units=" + unit.proj;
      SCOPED_TRACE(t.srs);
      // 4 km posts, west and north of the origin and beyond.
      t.dx = 4000 / unit.metres, t.dy = -t.dx, t.west = -110000 / unit.metres, t.north = 60000 / unit.metres;
      const RasterInfo info = inspect_raster(put(t));
      EXPECT_EQ(info.projection(), named.projection);
      const GdalPlane plane(t.srs);
      for (const auto& [column, row] : {std::pair{0, 0}, {39, 29}, {0, 29}, {39, 0}, {23, 7}}) {
        const Geographic g = plane.place(t.west + (column + 0.5) * t.dx, t.north + (row + 0.5) * t.dy);
        const Geographic ours = place_of_post(info, column, row);
        EXPECT_LT(distance_m(ours, g), 1e-9 * kMetresPerDegree);
        const PostXY back = locate(info, ours.lat_deg, ours.lon_deg), of_gdal = locate(info, g.lat_deg, g.lon_deg);
        EXPECT_NEAR(back.x, column, 1e-9);
        EXPECT_NEAR(back.y, row, 1e-9);
        EXPECT_NEAR(of_gdal.x, column, 1e-8);
        EXPECT_NEAR(of_gdal.y, row, 1e-8);
      }
      Raster raster(info);
      EXPECT_EQ(post_of(raster, 23, 7), 723);
      EXPECT_TRUE(std::isnan(post_of(raster, -1, 7)));
      EXPECT_EQ(info.lattice_level, std::nullopt);
    }
}

// EPSG's method 1026, as IAU-style coordinate systems have it.
TEST_F(ProjectedRaster, SphericalMercatorIsMercator) {
  PlaneTiff t;
  t.srs = R"w(PROJCRS["Mercator",BASEGEOGCRS["Moon",DATUM["Moon",ELLIPSOID["Moon",1737400,0,LENGTHUNIT["metre",1]]],)w"
          R"w(PRIMEM["Reference Meridian",0,ANGLEUNIT["degree",0.0174532925199433]]],)w"
          R"w(CONVERSION["M",METHOD["Mercator (Spherical)"],)w"
          R"w(PARAMETER["Latitude of natural origin",0,ANGLEUNIT["degree",0.0174532925199433]],)w"
          R"w(PARAMETER["Longitude of natural origin",7,ANGLEUNIT["degree",0.0174532925199433]],)w"
          R"w(PARAMETER["False easting",300,LENGTHUNIT["metre",1]],)w"
          R"w(PARAMETER["False northing",-100,LENGTHUNIT["metre",1]]],)w"
          R"w(CS[Cartesian,2],AXIS["(E)",east,ORDER[1],LENGTHUNIT["metre",1]],)w"
          R"w(AXIS["(N)",north,ORDER[2],LENGTHUNIT["metre",1]]])w";
  const RasterInfo spherical = inspect_raster(put(t));
  t.srs = "+proj=merc +lon_0=7 +x_0=300 +y_0=-100 +R=1737400 +units=m +no_defs";
  const RasterInfo variant_a = inspect_raster(put(t));
  EXPECT_EQ(spherical.projection(), Projection::mercator);
  for (const auto& [column, row] : {std::pair{0, 0}, {39, 29}})
    EXPECT_LT(distance_m(place_of_post(spherical, column, row), place_of_post(variant_a, column, row)), 1e-9);
}

TEST_F(ProjectedRaster, SouthUpAndEastToWestAreTurned) {
  PlaneTiff t;
  t.srs = "+proj=ortho +lat_0=26 +lon_0=3 +R=1737400 +units=m +no_defs";
  const Geographic north_up = place_of_post(inspect_raster(put(t)), 0, 0);
  t.west += 40 * t.dx, t.dx = -t.dx, t.north += 30 * t.dy, t.dy = -t.dy;
  const RasterInfo info = inspect_raster(put(t));
  EXPECT_LT(distance_m(place_of_post(info, 0, 0), north_up), 1e-6);
  Raster raster(info);
  EXPECT_EQ(post_of(raster, 0, 0), 2939);  // the file's last
  EXPECT_EQ(post_of(raster, 39, 29), 0);
}

// What is written is what is read, for all that a plane can be.
TEST_F(ProjectedRaster, MapsAreReadBackOnTheirOwnPlane) {
  using enum MapProjection;
  const std::vector<float> heights(12, 7.F);
  const MapBand band{"height", "m", heights.data()};
  for (const MapPlane& plane :
       {MapPlane{orthographic, 26, 3}, MapPlane{orthographic, -90, 20}, MapPlane{orthographic, 0, -180},
        MapPlane{stereographic, 90, 0}, MapPlane{stereographic, -90, 15, 0, 0.97}, MapPlane{stereographic, 30, 20},
        MapPlane{stereographic, -30, -20, 0, 0.99}, MapPlane{mercator, 0, 100}, MapPlane{mercator, 0, 0, 0, 0.8},
        MapPlane{transverse_mercator, 0, 10, 0, 0.9996}, MapPlane{transverse_mercator, -20, -170}}) {
    SCOPED_TRACE(wkt_of(plane));
    const std::string path = folder_ / "map.tif";
    std::ofstream(path, std::ios::binary) << geotiff_bytes({plane, -1000, 2000, 250, 4, 3}, {&band, 1}, "{}", {});
    const RasterInfo info = inspect_raster(path);
    const auto* grid = std::get_if<PlaneGrid>(&info.grid);
    ASSERT_TRUE(grid);
    EXPECT_EQ(grid->plane.projection, plane.projection);
    EXPECT_NEAR(grid->plane.lat_deg, plane.lat_deg, 1e-12);
    EXPECT_NEAR(grid->plane.lon_deg, plane.lon_deg, 1e-12);
    EXPECT_NEAR(grid->plane.scale, plane.scale, 1e-12);
    EXPECT_EQ(grid->first_x_m, -875);
    EXPECT_EQ(grid->first_y_m, 1875);
    EXPECT_EQ(grid->spacing_m, 250);
  }
}

// ---- spacing

TEST_F(ProjectedRaster, SpacingIsThatOnTheGround) {
  const auto spacing_m = [&](const std::string& srs, double north_m) {
    PlaneTiff t;
    t.srs = srs + " +R=1737400 +units=m +no_defs", t.west = -2000, t.north = north_m;
    return inspect_raster(put(t)).post_spacing_m;
  };
  EXPECT_NEAR(spacing_m("+proj=ortho +lat_0=26 +lon_0=3", 1500), 100, 1e-9);
  EXPECT_NEAR(spacing_m("+proj=stere +lat_0=26 +lon_0=3 +k_0=0.5", 1500), 200, 1e-9);
  EXPECT_NEAR(spacing_m("+proj=tmerc +lat_0=0 +lon_0=3 +k_0=0.5", 1500), 200, 1e-3);
  EXPECT_NEAR(spacing_m("+proj=merc +lon_0=3", 1500), 100, 1e-3);
  // Of Mercator in the file's middle: at 60 degrees it is twice as large as on the equator.
  const double at_60_m = kMoonRadius_m * std::atanh(std::sin(60 * kRadiansPerDegree));
  EXPECT_NEAR(spacing_m("+proj=merc +lon_0=3", at_60_m + 1500), 50, 1e-3);
  EXPECT_NEAR(spacing_m("+proj=merc +lon_0=3 +lat_ts=60", at_60_m / 2 + 1500), 100, 1e-3);
}

// ---- footprints

// The box of all posts, the longitudes being counted from the place in the middle.
Footprint box_of_posts(const RasterInfo& info) {
  const PlanePosts posts(std::get<PlaneGrid>(info.grid), info.width, info.height);
  const double middle_deg = place_of_post(info, info.width / 2, info.height / 2).lon_deg;
  Footprint box{90, -90, 360, -360};
  for (int y = 0; y < info.height; ++y)
    for (int x = 0; x < info.width; ++x) {
      if (!posts.on_moon(x, y)) continue;
      const Geographic g = place_of_post(info, x, y);
      const double lon_deg = middle_deg + std::remainder(g.lon_deg - middle_deg, 360);
      box = {std::min(box.south_deg, g.lat_deg), std::max(box.north_deg, g.lat_deg), std::min(box.west_deg, lon_deg),
             std::max(box.east_deg, lon_deg)};
    }
  return box;
}

TEST_F(ProjectedRaster, FootprintsAreTightAroundThePosts) {
  for (const Named& named : kPlanes) {
    PlaneTiff t;
    t.srs = std::string(named.srs) + " +R=1737400 +units=m +no_defs";
    t.west = 61000, t.north = 203000, t.dx = 5000, t.dy = -5000;
    const RasterInfo info = inspect_raster(put(t));
    const Footprint &f = info.footprint, box = box_of_posts(info);
    SCOPED_TRACE(t.srs);
    // No post is outside; a border may bulge between the outermost posts.
    const double bulge_deg = 0.01;
    const double turn_deg = 360 * std::round((f.west_deg - box.west_deg) / 360);
    for (const auto& [inner, outer] : {std::pair{-box.south_deg, -f.south_deg},
                                       {box.north_deg, f.north_deg},
                                       {-box.west_deg - turn_deg, -f.west_deg},
                                       {box.east_deg + turn_deg, f.east_deg}}) {
      EXPECT_LE(inner, outer + 1e-9);
      EXPECT_GE(inner, outer - bulge_deg);
    }
  }
}

TEST_F(ProjectedRaster, FootprintWithAPole) {
  for (const char* srs :
       {"+proj=ortho +lat_0=-89 +lon_0=50", "+proj=stere +lat_0=-89 +lon_0=50", "+proj=tmerc +lat_0=-89 +lon_0=50"}) {
    PlaneTiff t;
    t.srs = std::string(srs) + " +R=1737400 +units=m +no_defs";
    t.dx = 2000, t.dy = -2000, t.west = -40000, t.north = 30000;  // the pole is 30.3 km to the south
    EXPECT_NEAR(inspect_raster(put(t)).footprint.south_deg, -90 + 1.3 / 30.3, 0.01) << srs;
    EXPECT_LT(inspect_raster(put(t)).footprint.east_deg - inspect_raster(put(t)).footprint.west_deg, 181) << srs;
    t.north = 20000;
    const Footprint f = inspect_raster(put(t)).footprint;
    EXPECT_EQ(f.south_deg, -90) << srs;
    EXPECT_EQ(f.east_deg - f.west_deg, 360) << srs;
    EXPECT_NEAR(f.north_deg, -90 + std::hypot(39, 19 + 30.32) / 30.32, 0.01) << srs;
  }
}

// ---- the limb of an orthographic map

class WholeDisc : public ProjectedRaster {
 protected:
  // 90 x 90 posts, 40 km apart, of a hemisphere and what is beside its disc.
  PlaneTiff disc(double lat_deg, double lon_deg) const {
    PlaneTiff t;
    t.srs = fmt::format("+proj=ortho +lat_0={} +lon_0={} +R=1737400 +units=m +no_defs", lat_deg, lon_deg);
    t.width = t.height = 90, t.dx = 40000, t.dy = -40000, t.west = -1.8e6, t.north = 1.8e6;
    return t;
  }
};

TEST_F(WholeDisc, HasNoHeightsBesideTheMoon) {
  const RasterInfo info = inspect_raster(put(disc(20, 30)));  // with numbers in its corners
  Raster raster(info);
  std::vector<float> posts(90 * 90);
  raster.read(0, 0, 90, 90, posts.data());
  for (int y = 0; y < 90; ++y)
    for (int x = 0; x < 90; ++x) {
      const double from_axis_m = std::hypot(-1.78e6 + x * 4e4, 1.78e6 - y * 4e4);
      const float post = posts[static_cast<std::size_t>(90 * y + x)];
      EXPECT_EQ(std::isnan(post), from_axis_m > kMoonRadius_m) << x << " " << y;
      EXPECT_EQ(std::isnan(post_of(raster, x, y)), std::isnan(post));
    }
  // The far side is nowhere.
  EXPECT_LT(locate(info, -20, -150).x, -1e6);
  EXPECT_NEAR(locate(info, 20, 30).x, 44.5, 1e-9);
}

TEST_F(WholeDisc, Footprints) {
  const Footprint f = inspect_raster(put(disc(0, 30))).footprint;
  EXPECT_NEAR(f.south_deg, -90, 1e-3);
  EXPECT_NEAR(f.north_deg, 90, 1e-3);
  EXPECT_NEAR(f.west_deg, -60, 1e-3);
  EXPECT_NEAR(f.east_deg, 120, 1e-3);
  const Footprint of_20_deg = inspect_raster(put(disc(20, 30))).footprint;
  EXPECT_EQ(of_20_deg.north_deg, 90);
  EXPECT_NEAR(of_20_deg.south_deg, -70, 1e-3);
  EXPECT_EQ(of_20_deg.east_deg - of_20_deg.west_deg, 360);
  const Footprint of_pole = inspect_raster(put(disc(-90, 0))).footprint;
  EXPECT_EQ(of_pole.south_deg, -90);
  EXPECT_NEAR(of_pole.north_deg, 0, 1e-3);
}

TEST_F(WholeDisc, BesideItIsNothing) {
  PlaneTiff t = disc(0, 30);
  t.west = 1.3e6, t.north = 1.3e6 + 52 * 4e4, t.width = t.height = 52;
  EXPECT_NE(refusal(t).find("beyond the limb"), std::string::npos) << refusal(t);
}

// ---- what is refused

// Maps of spheres are similar.
TEST_F(ProjectedRaster, RadiiOnAnotherSphereLieWhereTheirDegreesAre) {
  for (const Named& named : {kPlanes[0], kPlanes[4], kPlanes[7], kPlanes[9], kPlanes[11]}) {
    PlaneTiff t;
    t.posts.resize(static_cast<std::size_t>(t.width) * static_cast<std::size_t>(t.height));
    for (std::size_t i = 0; i < t.posts.size(); ++i) t.posts[i] = static_cast<float>(1738000 + i % 97);
    t.srs = named.srs + std::string(" +R=1738000 +units=m +no_defs");
    const RasterInfo info = inspect_raster(put(t));
    const Geographic expected = GdalPlane(t.srs).place(t.west + 7.5 * t.dx, t.north + 9.5 * t.dy);
    EXPECT_LT(distance_m(place_of_post(info, 7, 9), expected), 1e-3) << t.srs;
  }
}

constexpr const char* kWarpLine = "gdalwarp -t_srs '+proj=longlat +R=1737400 +no_defs' -r cubic in.tif out.tif";

TEST_F(ProjectedRaster, OtherProjectionsAreRefusedWithAWayOut) {
  PlaneTiff t;
  for (const char* srs : {"+proj=sinu +lon_0=0", "+proj=laea +lat_0=20 +lon_0=0", "+proj=gnom +lat_0=20 +lon_0=0",
                          "+proj=lcc +lat_1=20 +lat_2=30 +lon_0=0"}) {
    t.srs = std::string(srs) + " +R=1737400 +units=m +no_defs";
    EXPECT_NE(refusal(t).find("is not supported"), std::string::npos) << refusal(t);
    EXPECT_NE(refusal(t).find(kWarpLine), std::string::npos) << refusal(t);
    EXPECT_NE(refusal(t).find("p.tif"), std::string::npos) << refusal(t);
  }
}

TEST_F(ProjectedRaster, OtherBodiesRotationsAndOblongPixelsAreRefused) {
  for (const Named& named : {kPlanes[0], kPlanes[4], kPlanes[9], kPlanes[11]}) {
    PlaneTiff t;
    for (const char* body : {" +ellps=WGS84", " +R=1737000", " +a=1738100 +b=1736000"}) {
      t.srs = named.srs + std::string(body) + " +units=m +no_defs";
      EXPECT_NE(refusal(t).find("is not the Moon's sphere"), std::string::npos) << t.srs << refusal(t);
    }
    t.srs = named.srs + std::string(" +R=1737400 +units=m +no_defs");
    t.rotation = 3;
    EXPECT_NE(refusal(t).find("rotated"), std::string::npos) << refusal(t);
    EXPECT_NE(refusal(t).find(kWarpLine), std::string::npos) << refusal(t);
    t.rotation = 0, t.dy = -101;
    EXPECT_NE(refusal(t).find("not square"), std::string::npos) << refusal(t);
  }
}

// ---- heights

// Smooth at the poles, too.
double waves(double lat_deg, double lon_deg) {
  const Vec3 p = to_cartesian({lat_deg, lon_deg, 0}) / kMoonRadius_m;
  return 800 * std::sin(40 * p.x()) + 900 * std::sin(30 * p.y() + 20 * p.z());
}

// Terrain has the heights of the function, whatever the plane: over the date line, at a pole and beside it.
TEST_F(ProjectedRaster, TerrainHasItsHeights) {
  for (const char* srs :
       {"+proj=ortho +lat_0=26.1 +lon_0=3.6", "+proj=ortho +lat_0=-50 +lon_0=180", "+proj=ortho +lat_0=-90 +lon_0=20",
        "+proj=ortho +lat_0=89 +lon_0=20", "+proj=stere +lat_0=-43 +lon_0=-11.2 +k_0=0.98",
        "+proj=stere +lat_0=-89.5 +lon_0=60", "+proj=merc +lon_0=180 +lat_ts=40", "+proj=merc +lon_0=10",
        "+proj=tmerc +lat_0=30 +lon_0=9 +k_0=0.9996", "+proj=tmerc +lat_0=90 +lon_0=9"}) {
    SCOPED_TRACE(srs);
    PlaneTiff t;
    t.srs = std::string(srs) + " +R=1737400 +units=m +no_defs";
    t.width = t.height = 100, t.dx = 1000, t.dy = -1000, t.west = -50000, t.north = 50000;
    put(t, waves);
    const auto terrain = test::open_terrain(folder_.path());
    const RasterInfo& info = terrain->catalogue().rasters()[0];
    double worst_m = 0;
    for (int y = 1; y < 98; y += 4)
      for (int x = 1; x < 98; x += 4) {
        const Geographic g = PlanePosts(std::get<PlaneGrid>(info.grid), 100, 100).position(x + 0.4, y + 0.7);
        const HeightAnswer answer = terrain->height(g.lat_deg, g.lon_deg);
        ASSERT_EQ(answer.source, 0) << x << " " << y;
        worst_m = std::max(worst_m, std::abs(answer.height_m - waves(g.lat_deg, g.lon_deg)));
      }
    EXPECT_LT(worst_m, 0.2);  // heights differ by up to 18 m from post to post
    const ResamplingError error = resampling_error(*terrain, 0, 300);
    EXPECT_GT(error.posts, 280);
    EXPECT_LT(error.worst_m, 0.2);
  }
}

// All around the Moon: the first column follows the last one.
TEST_F(ProjectedRaster, MercatorGoesAroundTheMoon) {
  PlaneTiff t;
  t.srs = "+proj=merc +lon_0=40 +R=1737400 +units=m +no_defs";
  const double around_m = 360 * kMetresPerDegree;
  t.width = 2880, t.height = 40, t.dx = around_m / t.width, t.dy = -t.dx, t.west = -around_m / 2, t.north = 20 * t.dx;
  const auto height_m = [](double lat_deg, double lon_deg) {
    return 100 * std::sin(lon_deg * kRadiansPerDegree) + 20 * lat_deg;
  };
  const RasterInfo info = inspect_raster(put(t, height_m));
  EXPECT_NEAR(info.footprint.west_deg, -139.9375, 1e-9);
  EXPECT_NEAR(info.footprint.east_deg, 219.9375, 1e-9);
  const auto terrain = test::open_terrain(folder_.path());
  for (double lon_deg = -142; lon_deg < -138; lon_deg += 0.01)  // the seam is at -140
    EXPECT_NEAR(terrain->height(0.3, lon_deg).height_m, height_m(0.3, lon_deg), 0.05) << lon_deg;
}

// Tiles of one grid are one layer over a coarser one, and as one file.
TEST_F(ProjectedRaster, TilesOfAGridAreOneLayer) {
  for (const char* srs : {"+proj=tmerc +lat_0=60 +lon_0=100", "+proj=ortho +lat_0=60 +lon_0=100"}) {
    SCOPED_TRACE(srs);
    PlaneTiff all;
    all.srs = std::string(srs) + " +R=1737400 +units=m +no_defs";
    all.width = 256, all.height = 256, all.dx = 500, all.dy = -500, all.west = -64000, all.north = 64000;
    PlaneTiff half = all;
    half.width = 128;
    const test::TemporaryFolder one, two;
    for (const std::string& folder : {one.path(), two.path()})
      test::write_float_tile(folder, "beneath", {70, 80, 4, 20 * 4 + 1, 40 * 4 + 1},
                             [](double, double) { return 5000.0; });
    std::filesystem::copy(put(all, waves), one / "all.tif");
    std::filesystem::copy(put(half, waves), two / "west.tif");
    half.west += 128 * half.dx;
    std::filesystem::copy(put(half, waves), two / "east.tif");
    const auto posts_of = [](const std::string& folder) {
      Catalogue catalogue(std::vector<std::string>{folder});
      join_layers(catalogue, 1, {});
      const PostSource source(catalogue, false, [](const std::string&, const std::string&) {});
      const Tick step = 1 << (kTickLevel - 6);
      return source.compose({std::llround((90 + 57.5) * kTicksPerDegree), std::llround((180 + 95.0) * kTicksPerDegree),
                             step, step, 320, 640});
    };
    const Posts a = posts_of(one.path()), b = posts_of(two.path());
    int of_tiles = 0, own = 0;
    for (std::size_t i = 0; i < a.heights.size(); ++i) {
      ASSERT_NEAR(a.heights[i], b.heights[i], 2) << i;  // the band follows the scale in the middle of a file
      of_tiles += a.heights[i] < 4999, own += a.heights[i] < 2000;
    }
    EXPECT_GT(of_tiles, 20000);
    EXPECT_GT(own, 10000);
  }
}

// A site around the south pole keeps its posts; all around it the globe bends to meet them.
TEST_F(ProjectedRaster, ASiteAtAPoleIsUnchanged) {
  PlaneTiff t;
  t.srs = "+proj=stere +lat_0=-90 +lon_0=0 +R=1737400 +units=m +no_defs";
  t.width = t.height = 200, t.dx = 500, t.dy = -500, t.west = -50000, t.north = 50000;
  put(t, [](double, double) { return 100.0; });
  test::write_global_tile(folder_.path(), 4, [](double, double) { return 0.0; });
  Catalogue catalogue(std::vector<std::string>{folder_.path()});
  ASSERT_EQ(catalogue.rasters().size(), 2U);
  join_layers(catalogue, 4, {});
  const PostSource source(catalogue, false, [](const std::string&, const std::string&) {});
  // From the pole to 85 S, every 474 m along each fifth meridian.
  constexpr int kRows = 5 * 64, kCols = 72;
  const Posts posts = source.compose({0, 0, 1 << (kTickLevel - 6), 5 << kTickLevel, kRows, kCols});
  int fine = 0;
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      const auto at = static_cast<std::size_t>(r * kCols + c);
      if (source_of(posts.sources[at]) == 1) {
        ++fine;
        ASSERT_EQ(posts.heights[at], 100) << r << ' ' << c;
        ASSERT_FALSE(is_blended(posts.sources[at]));
      }
      if (r == 0) continue;
      const float below_m = posts.heights[static_cast<std::size_t>((r - 1) * kCols + c)];
      ASSERT_LE(posts.heights[at], below_m + 1e-3F) << r << ' ' << c;
      // A band of 4 posts of 7.6 km is 64 posts wide.
      ASSERT_LT(below_m - posts.heights[at], 100 * 3.0 / 64) << r << ' ' << c;
    }
  EXPECT_GT(fine, 100 * kCols);
  for (int c = 0; c < kCols; ++c) EXPECT_EQ(posts.heights[static_cast<std::size_t>((kRows - 1) * kCols + c)], 0);
}

// The coarser layer beside an orthographic one meets it at its limb without a cliff.
TEST_F(WholeDisc, TheCoarserLayerBendsToItsLimb) {
  PlaneTiff t = disc(0, 0);
  t.width = t.height = 360, t.dx = 10000, t.dy = -10000;
  put(t, [](double, double) { return 1000.0; });
  test::write_global_tile(folder_.path(), 1, [](double, double) { return 0.0; });
  Catalogue catalogue(std::vector<std::string>{folder_.path()});
  join_layers(catalogue, 4, {});
  ASSERT_EQ(catalogue.rasters().size(), 2U);
  const PostSource source(catalogue, false, [](const std::string&, const std::string&) {});
  const Tick step = 1 << (kTickLevel - 4);
  // Along the equator from 0 to 130 degrees east: the plane foreshortens the band, which begins at its limb.
  const Posts posts = source.compose({90LL * kTicksPerDegree, 180LL * kTicksPerDegree, step, step, 1, 130 * 16 + 1});
  EXPECT_EQ(posts.heights.front(), 1000);
  EXPECT_EQ(posts.heights.back(), 0);
  EXPECT_EQ(posts.heights[60 * 16], 1000);
  float steepest_m = 0;
  for (std::size_t i = 1; i < posts.heights.size(); ++i) {
    ASSERT_FALSE(std::isnan(posts.heights[i])) << i;
    steepest_m = std::max(steepest_m, std::abs(posts.heights[i] - posts.heights[i - 1]));
  }
  EXPECT_LT(steepest_m, 200);
}

}  // namespace
}  // namespace selenograph::dem
