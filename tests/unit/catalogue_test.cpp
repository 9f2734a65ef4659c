// Which files are found, in what order, and which of them lie where.
#include "dem/catalogue/catalogue.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <random>

#include "dem/base/error.h"
#include "dem/files/quantity.h"
#include "dem/grid/geodesy.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;
using test::shared_data;

// A tile of one degree, 8 x 8 posts, in Kaguya's format.
std::string tile_label(const std::string& image_pointer, double south, double west) {
  const auto line = [](const std::string& key, double v) { return key + " = " + std::to_string(v) + "\r\n"; };
  return "PDS_VERSION_ID = \"PDS3\"\r\nMISSION_NAME = SELENE\r\nRECORD_BYTES = 1024\r\n^IMAGE = " + image_pointer +
         "\r\n" +
         "OBJECT = IMAGE_MAP_PROJECTION\r\nMAP_PROJECTION_TYPE = \"SIMPLE CYLINDRICAL\"\r\nMAP_RESOLUTION = 8\r\n" +
         line("MAXIMUM_LATITUDE", south + 1) + line("MINIMUM_LATITUDE", south + 0.125) +
         line("WESTERNMOST_LONGITUDE", west) + line("EASTERNMOST_LONGITUDE", west + 0.875) +
         line("LINE_PROJECTION_OFFSET", 8 * (south + 1)) + line("SAMPLE_PROJECTION_OFFSET", -8 * west) +
         "END_OBJECT\r\nOBJECT = IMAGE\r\nLINES = 8\r\nLINE_SAMPLES = 8\r\nSAMPLE_TYPE = MSB_INTEGER\r\n"
         "SAMPLE_BITS = 16\r\nEND_OBJECT\r\nEND\r\n";
}

class CatalogueTest : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  void put(const std::string& name, const std::string& bytes) const {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
  }
  void put_tile(const std::string& stem, double south, double west, const char* label = ".lbl",
                const char* data = ".img") const {
    put(stem + label, tile_label("\"" + fs::path(stem).filename().string() + data + "\"", south, west));
    put(stem + data, std::string(128, '\1'));
  }

  const test::TemporaryFolder own_;
  const fs::path folder_ = own_.path();
};

std::vector<std::string> names(const Catalogue& c) {
  std::vector<std::string> out;
  for (const RasterInfo& r : c.rasters()) out.push_back(r.name);
  return out;
}

RasterInfo tile(double south, double west, double size = 1, double spacing_m = 7.4, const std::string& name = "") {
  RasterInfo r;
  r.name = name;
  r.path = name;
  r.post_spacing_m = spacing_m;
  r.footprint = {south, south + size - size / 4096, wrap_lon_deg(west), wrap_lon_deg(west) + size - size / 4096};
  return r;
}

TEST_F(CatalogueTest, FindsAllTiles) {
  put_tile("a/DTM_A", 0, 10);
  put_tile("a/b/DTM_B", 0, 11, ".LBL", ".IMG");
  std::string attached = tile_label("2", 0, 12);
  attached.resize(1024, ' ');
  put("a/attached.img", attached + std::string(128, '\1'));
  put("a/notes.txt", "nothing");
  put("a/DTM_A.jpg", "nothing");
  put_tile("a/named", 0, 13);
  fs::rename(path("a/named.lbl"), path("a/its_label.lbl"));
  put("a/scene.lbl", "PDS_VERSION_ID = PDS3\n^IMAGE = \"scene.img\"\nOBJECT = IMAGE\nLINES = 3\nEND_OBJECT\nEND\n");
  put("a/scene.img", "radiances");
  const Catalogue c({path("a")});
  EXPECT_EQ(names(c), (std::vector<std::string>{"DTM_A", "DTM_B", "attached", "its_label"}));
  EXPECT_TRUE(c.problems().empty()) << c.problems()[0].path << ": " << c.problems()[0].what;
}

TEST_F(CatalogueTest, UnusableCandidatesAreReportedAndTheRestStays) {
  put_tile("good", 0, 10);
  put_tile("short", 0, 11);
  fs::resize_file(path("short.img"), 127);
  put_tile("gone", 0, 12);
  fs::remove(path("gone.img"));
  put("garbage.lbl", "\x01\x02\x03");
  put("empty.tif", "");
  put("text.VRT", "no");
  const Catalogue c({folder_.string()});
  EXPECT_EQ(names(c), std::vector<std::string>{"good"});
  std::vector<std::string> bad;
  for (const auto& p : c.problems()) {
    bad.push_back(fs::path(p.path).filename().string());
    EXPECT_FALSE(p.what.empty());
    EXPECT_EQ(p.what.find(folder_.string() + "/" + bad.back() + ": "), std::string::npos) << p.what;
  }
  EXPECT_EQ(bad, (std::vector<std::string>{"empty.tif", "garbage.lbl", "gone.lbl", "short.lbl", "text.VRT"}));
}

TEST_F(CatalogueTest, AnImageWithoutItsLabelIsReported) {
  put_tile("good", 0, 10);
  put("lonely.img", "pixels without a label");
  const Catalogue c({folder_.string()});
  EXPECT_EQ(names(c), std::vector<std::string>{"good"});
  ASSERT_EQ(c.problems().size(), 1U);
  EXPECT_EQ(c.problems()[0].path, path("lonely.img"));
  EXPECT_NE(c.problems()[0].what.find("label"), std::string::npos);
  EXPECT_TRUE(c.problems()[0].unrelated) << "terrain is served all the same";
}

// LOLA's folder with its JPEG 2000 images: the label of LDEM_4.JP2 names LDEM_4.IMG, too, and places it elsewhere.
TEST_F(CatalogueTest, ALabelBelongsToItsOwnImage) {
  put_tile("LDEM_8", 0, 10);
  put("LDEM_8_JP2.LBL", tile_label("\"LDEM_8.img\"", 0, 190));
  const Catalogue c({folder_.string()});
  EXPECT_EQ(names(c), std::vector<std::string>{"LDEM_8"});
  EXPECT_EQ(c.rasters()[0].footprint.west_deg, 10);
  ASSERT_EQ(c.problems().size(), 1U);
  EXPECT_EQ(c.problems()[0].path, path("LDEM_8_JP2.LBL"));
  EXPECT_EQ(c.problems()[0].what, "describes LDEM_8.img, whose own label is LDEM_8.lbl");
  EXPECT_TRUE(c.problems()[0].unrelated);
  EXPECT_THROW(Catalogue({path("LDEM_8_JP2.LBL")}), NotHeights);
  EXPECT_EQ(Catalogue({path("LDEM_8.img")}).rasters()[0].footprint.west_deg, 10);
}

TEST_F(CatalogueTest, ALabelOfACompressedImageIsRefused) {
  put("map.img", std::string(128, '\1'));
  std::string label = tile_label("\"map.img\"", 0, 10);
  label.insert(label.find("OBJECT"), "OBJECT = COMPRESSED_FILE\r\nFILE_NAME = \"MAP.JP2\"\r\nEND_OBJECT\r\n");
  put("map_jp2.lbl", label);
  const Catalogue c({folder_.string()});
  EXPECT_TRUE(c.rasters().empty());
  ASSERT_EQ(c.problems().size(), 1U);
  EXPECT_NE(c.problems()[0].what.find("the compressed file MAP.JP2"), std::string::npos) << c.problems()[0].what;
  put("tiff.lbl", tile_label("\"tiff.tif\"", 0, 10));
  put("tiff.tif", "II*");
  EXPECT_THROW(Catalogue({path("tiff.lbl")}), NotHeights);
}

TEST_F(CatalogueTest, AnImageWhoseLabelDescribesAnotherIsRefused) {
  put_tile("b", 0, 10);
  fs::remove(path("b.lbl"));
  put("a.lbl", tile_label("\"b.img\"", 0, 10));
  put("a.img", std::string(128, '\1'));
  const Catalogue c({folder_.string()});
  EXPECT_EQ(names(c), std::vector<std::string>{"a"});
  ASSERT_EQ(c.problems().size(), 1U);
  EXPECT_EQ(c.problems()[0].path, path("a.img"));
  EXPECT_NE(c.problems()[0].what.find("its label a.lbl describes b.img"), std::string::npos) << c.problems()[0].what;
  try {
    Catalogue({path("a.img")});
    ADD_FAILURE() << "a.img was read by the label of b.img";
  } catch (const DataError& error) {
    EXPECT_NE(std::string(error.what()).find("its label a.lbl describes b.img"), std::string::npos) << error.what();
  }
  // Two labels of other names.
  fs::remove(path("a.img"));
  put("c.lbl", tile_label("\"b.img\"", 0, 190));
  const Catalogue two({folder_.string()});
  EXPECT_EQ(names(two), std::vector<std::string>{"a"});
  ASSERT_EQ(two.problems().size(), 1U);
  EXPECT_NE(two.problems()[0].what.find("describes b.img, as does"), std::string::npos) << two.problems()[0].what;
}

// The files of LOLA's 5 m sites and gridded products, in one folder: each has plausible values.
TEST_F(CatalogueTest, RastersOfOtherQuantitiesAreSideLayers) {
  constexpr const char* kOthers[] = {"site_slp", "site_toterr",       "LDSM_16",        "LDRM_16",
                                     "LDEC_16",  "AVGVISIB_85S_060M", "site_hillshade", "albedo"};
  put_tile("site_surf", 0, 10);
  for (const char* name : kOthers) put_tile(name, 0, 10);
  std::string label = tile_label("\"by_label.img\"", 0, 10);
  label.insert(label.find("LINES"), "NAME = SLOPE\r\n");
  put("by_label.lbl", label);
  put("by_label.img", std::string(128, '\1'));
  label.replace(label.find("NAME = SLOPE"), 12, "NAME = HEIGHT");
  label.replace(label.find("by_label"), 8, "n_slopes");
  put("n_slopes.lbl", label);
  put("n_slopes.img", std::string(128, '\1'));
  const Catalogue c({folder_.string()});
  EXPECT_EQ(names(c), (std::vector<std::string>{"n_slopes", "site_surf"}));
  EXPECT_TRUE(c.problems().empty());
  EXPECT_EQ(c.side_layers().size(), std::size(kOthers) + 1);
  try {
    Catalogue({path("site_slp.lbl")});
    ADD_FAILURE() << "slopes were read as heights";
  } catch (const SideRaster& error) {
    EXPECT_NE(std::string(error.what()).find("describe its band"), std::string::npos) << error.what();
  }
}

TEST_F(CatalogueTest, APds4LabelIsReported) {
  put("t.xml", "<?xml version=\"1.0\"?>\n<Product_Observational xmlns=\"http://pds.nasa.gov/pds4/pds/v1\"/>");
  put("notes.xml", "<notes/>");
  const Catalogue c({folder_.string()});
  ASSERT_EQ(c.problems().size(), 1U);
  EXPECT_EQ(c.problems()[0].path, path("t.xml"));
  EXPECT_NE(c.problems()[0].what.find("gdal_translate"), std::string::npos);
  EXPECT_TRUE(c.problems()[0].unrelated);
}

TEST_F(CatalogueTest, ImpossibleScalesAreReportedWithTheirPlace) {
  put_tile("good", 0, 10);
  for (const char* line : {"SCALING_FACTOR = 1e308", "SCALING_FACTOR = 1e-300", "OFFSET = 1e300", "OFFSET = 3e6",
                           "SCALING_FACTOR = 1e305\r\nUNIT = KM"}) {
    put_tile("bad", 0, 11);
    std::string label = tile_label("\"bad.img\"", 0, 11);
    label.insert(label.find("SAMPLE_TYPE"), std::string(line) + "\r\n");
    put("bad.lbl", label);
    const Catalogue c({folder_.string()});
    ASSERT_EQ(c.problems().size(), 1U) << line;
    EXPECT_EQ(c.problems()[0].path, path("bad.lbl"));
    EXPECT_NE(c.problems()[0].what.find("impossible"), std::string::npos) << c.problems()[0].what;
    EXPECT_TRUE(c.problems()[0].located) << line;
    ASSERT_EQ(names(c).size(), 2U);
    const RasterInfo& bad = c.rasters()[names(c)[0] == "bad" ? 0 : 1];
    EXPECT_FALSE(bad.damage.empty());
    EXPECT_TRUE(std::isfinite(bad.quantisation_m));
  }
}

TEST_F(CatalogueTest, SamplesThatAreNoHeightsAreReported) {
  std::string label = tile_label("\"t.img\"", 0, 11);
  label.replace(label.find("MSB_INTEGER"), 11, "PC_REAL");
  label.replace(label.find("SAMPLE_BITS = 16"), 16, "SAMPLE_BITS = 32");
  put("t.lbl", label);
  std::vector<float> posts(64, 5e8F);
  const auto put_posts = [&] {
    put("t.img", std::string(reinterpret_cast<const char*>(posts.data()), posts.size() * sizeof(float)));
  };
  put_posts();
  ASSERT_EQ(Catalogue({folder_.string()}).problems().size(), 1U);
  posts[0] = 7;  // one is: the others may be no-data that nobody declared
  put_posts();
  EXPECT_EQ(Catalogue({folder_.string()}).problems().size(), 0U);
  posts.assign(64, -3.4e38F);
  put_posts();
  EXPECT_EQ(Catalogue({folder_.string()}).problems().size(), 0U);
}

TEST_F(CatalogueTest, AContradictoryCornerIsReported) {
  put_tile("good", 0, 10);
  const auto problem_of = [&](const std::string& from, const std::string& to, const std::string& more = "") {
    put_tile("bad", 0, 11);
    std::string label = tile_label("\"bad.img\"", 0, 11);
    if (!from.empty()) label.replace(label.find(from), from.size(), to);
    label.insert(label.find("END_OBJECT"), more);
    put("bad.lbl", label);
    const Catalogue c({folder_.string()});
    return c.problems().empty() ? std::string() : c.problems()[0].what;
  };
  EXPECT_EQ(problem_of("", ""), "");
  // Corners that agree with each other, elsewhere than the offset says.
  EXPECT_NE(problem_of("MAXIMUM_LATITUDE = 1.000000\r\nMINIMUM_LATITUDE = 0.125000",
                       "MAXIMUM_LATITUDE = 31.000000\r\nMINIMUM_LATITUDE = 30.125000"),
            "");
  EXPECT_NE(problem_of("MAXIMUM_LATITUDE = 1.0", "MAXIMUM_LATITUDE = 2.0"), "");
  EXPECT_NE(problem_of("LINE_PROJECTION_OFFSET = 8.0", "LINE_PROJECTION_OFFSET = 88.0"), "");
  // The bounds and the corners, each told by itself.
  EXPECT_NE(problem_of("", "", "UPPER_LEFT_LATITUDE = 41\r\n"), "");
  EXPECT_NE(problem_of("", "", "LOWER_RIGHT_LONGITUDE = 200\r\n"), "");
  EXPECT_EQ(problem_of("", "", "UPPER_LEFT_LATITUDE = 1\r\nLOWER_RIGHT_LONGITUDE = 371.875\r\n"), "");
}

TEST_F(CatalogueTest, VrtSourcesMustBeLocalFiles) {
  for (const char* source : {"/vsicurl/http://127.0.0.1:9/a.tif", "http://127.0.0.1:9/a.tif", "/vsis3/bucket/a.tif",
                             "/vsizip/a.zip/a.tif", "&#47;vsicurl/http://127.0.0.1:9/a.tif"}) {
    put("v.vrt",
        std::string("<VRTDataset rasterXSize=\"8\" rasterYSize=\"8\"><VRTRasterBand dataType=\"Int16\" band=\"1\">"
                    "<SimpleSource><SourceFilename relativeToVRT=\"0\">") +
            source +
            "</SourceFilename><SourceBand>1</SourceBand><SourceProperties RasterXSize=\"8\" RasterYSize=\"8\" "
            "DataType=\"Int16\" BlockXSize=\"8\" BlockYSize=\"8\"/><SrcRect xOff=\"0\" yOff=\"0\" xSize=\"8\" "
            "ySize=\"8\"/><DstRect xOff=\"0\" yOff=\"0\" xSize=\"8\" ySize=\"8\"/></SimpleSource></VRTRasterBand>"
            "</VRTDataset>");
    const Catalogue c({folder_.string()});
    EXPECT_TRUE(c.rasters().empty());
    ASSERT_EQ(c.problems().size(), 1U);
    EXPECT_NE(c.problems()[0].what.find("not a file on this machine"), std::string::npos) << c.problems()[0].what;
  }
}

TEST_F(CatalogueTest, NamedFilesMustBeUsable) {
  put("garbage.lbl", "\x01\x02\x03");
  EXPECT_THROW(Catalogue({path("garbage.lbl")}), DataError);
  EXPECT_THROW(Catalogue({path("nowhere")}), DataError);
  EXPECT_THROW(Catalogue(std::vector<std::string>{path("nowhere.tif")}), DataError);
}

TEST_F(CatalogueTest, AFileGivenTwiceIsOneEntry) {
  put_tile("t", 0, 10);
  EXPECT_EQ(Catalogue({path("t.lbl"), path("t.img"), folder_.string(),
                       folder_.string() + "/../" + folder_.filename().string()})
                .rasters()
                .size(),
            1u);
}

TEST(Catalogue, SortsFromCoarseToFineThenByName) {
  const Catalogue c(std::vector<RasterInfo>{tile(0, 0, 1, 7, "b"), tile(0, 0, 1, 7, "a"), tile(0, 0, 1, 1900, "global"),
                                            tile(0, 0, 1, 2, "site")});
  EXPECT_EQ(names(c), (std::vector<std::string>{"global", "a", "b", "site"}));
}

TEST(Catalogue, HadleyAndTheGlobe) {
  const std::string hadley = shared_data("hadley"), global = shared_data("global");
  if (!fs::exists(hadley) || !fs::exists(global))
    GTEST_SKIP() << hadley << " is not here (set SELENOGRAPH_SHARED_DATA)";
  const Catalogue c({hadley, global, shared_data("ldem_4")});
  EXPECT_EQ(c.rasters().size(), 18u);
  EXPECT_TRUE(c.problems().empty());
  EXPECT_EQ(c.rasters()[0].name, "LDEM_4");
  EXPECT_EQ(c.rasters()[1].name, "GLD100_global_16ppd_m");
  const std::vector<int> site = c.touching(26.13, 26.14, 3.63, 3.64);
  ASSERT_EQ(site.size(), 3u);
  EXPECT_EQ(c.rasters()[static_cast<std::size_t>(site[2])].name, "DTM_MAPs02_N27E003N24E006SC");
  EXPECT_EQ(c.touching(-10, -9, 100, 101), (std::vector<int>{0, 1}));
}

// Every answer of the index against the plain definition.
TEST(Catalogue, TouchingAgreesWithBruteForce) {
  std::mt19937 random(7);
  const auto uniform = [&](double a, double b) { return std::uniform_real_distribution<>(a, b)(random); };
  std::vector<RasterInfo> rasters;
  for (int i = 0; i < 300; ++i) {
    RasterInfo r;
    r.footprint.south_deg = uniform(-90, 89);
    r.footprint.north_deg = std::min(90.0, r.footprint.south_deg + uniform(0, 5));
    r.footprint.west_deg = uniform(-180, 180);
    r.footprint.east_deg = r.footprint.west_deg + (i % 20 == 0 ? uniform(0, 360) : uniform(0, 5));
    rasters.push_back(r);
  }
  const Catalogue c(rasters);
  for (int k = 0; k < 2000; ++k) {
    const double south = uniform(-85, 80), north = south + uniform(0, 4), west = uniform(-700, 700);
    const double east = west + (k % 50 == 0 ? uniform(0, 500) : uniform(0, 4)), margin = k % 2 ? uniform(0, 1) : 0;
    std::vector<int> expected;
    for (std::size_t i = 0; i < c.rasters().size(); ++i) {
      const Footprint& f = c.rasters()[i].footprint;
      bool meets = false;
      for (int turn = -4; turn <= 4; ++turn)
        meets |= f.west_deg + 360 * turn <= east + margin && f.east_deg + 360 * turn >= west - margin;
      if (meets && f.south_deg <= north + margin && f.north_deg >= south - margin)
        expected.push_back(static_cast<int>(i));
    }
    ASSERT_EQ(c.touching(south, north, west, east, margin), expected) << south << " " << west << " " << margin;
  }
}

TEST(Catalogue, DateLineAndPoles) {
  const Catalogue c(std::vector<RasterInfo>{tile(0, 179, 1, 7, "E179"), tile(0, -180, 1, 7, "E180"),
                                            tile(0, 359, 1, 7, "E359"), tile(89, 0, 1, 7, "N0"),
                                            tile(89, 180, 1, 7, "N180")});
  const auto found = [&](double south, double north, double west, double east, double margin = 0) {
    std::string out;
    for (const int i : c.touching(south, north, west, east, margin))
      out += c.rasters()[static_cast<std::size_t>(i)].name + " ";
    return out;
  };
  EXPECT_EQ(found(0.2, 0.4, 179.5, 180.5), "E179 E180 ");
  EXPECT_EQ(found(0.2, 0.4, -180.5, -179.5), "E179 E180 ");
  EXPECT_EQ(found(0.2, 0.4, 540.2, 540.4), "E180 ");
  EXPECT_EQ(found(0.2, 0.4, -0.5, -0.4), "E359 ");
  EXPECT_EQ(found(0.2, 0.4, 359.5, 359.6), "E359 ");
  EXPECT_EQ(found(0.2, 0.4, 0.1, 0.2), "");
  EXPECT_EQ(found(0.2, 0.4, 0.1, 0.2, 0.2), "E359 ");
  EXPECT_EQ(found(0.2, 0.4, 180, 180, 0), "E180 ");
  EXPECT_EQ(found(0.2, 0.4, 180, 180, 0.001), "E179 E180 ");
  EXPECT_EQ(found(89.5, 90, 0, 0.5), "N0 ");
  EXPECT_EQ(found(89.5, 90, 0, 0.5, 0.1), "N0 N180 ");  // grown over the pole
  EXPECT_EQ(found(-90, 90, 0, 360), "E179 E180 E359 N0 N180 ");
  EXPECT_EQ(found(-90, 90, -1000, 1000, 50), "E179 E180 E359 N0 N180 ");
}

TEST(Catalogue, WholeMoonOfTiles) {
  std::vector<RasterInfo> tiles;
  for (int south = -90; south < 90; ++south)
    for (int west = 0; west < 360; ++west)
      tiles.push_back(tile(south, west, 1, 7.4, std::to_string(south) + "_" + std::to_string(west)));
  RasterInfo globe = tile(-90, -180, 1, 1900, "globe");
  globe.footprint = {-90, 90, -180, 180};
  tiles.push_back(globe);
  const Catalogue c(std::move(tiles));
  ASSERT_EQ(c.rasters().size(), 64801u);
  std::size_t most = 0, total = 0;
  for (int south = -89; south < 89; ++south)
    for (int west = -180; west < 180; west += 7) {
      const std::vector<int> hit = c.touching(south + 0.25, south + 0.75, west + 0.25, west + 0.75);
      ASSERT_EQ(hit.size(), 2u);  // the globe and that tile
      EXPECT_EQ(hit[0], 0);
      most = std::max(most, c.touching(south, south + 1, west, west + 1, 0.01).size());
      ++total;
    }
  EXPECT_EQ(most, 10u);  // the globe and 3 x 3 tiles
  EXPECT_GT(total, 9000u);
  EXPECT_EQ(c.touching(-90, 90, -180, 180).size(), 64801u);
}

TEST_F(CatalogueTest, FingerprintChangesWithTheFiles) {
  put_tile("t", 0, 10);
  const std::uint64_t before = Catalogue({folder_.string()}).fingerprint();
  EXPECT_EQ(Catalogue({path("t.lbl")}).fingerprint(), before);
  fs::last_write_time(path("t.img"), fs::last_write_time(path("t.img")) + std::chrono::seconds(2));
  const std::uint64_t touched = Catalogue({folder_.string()}).fingerprint();
  EXPECT_NE(touched, before);
  put_tile("u", 0, 11);
  EXPECT_NE(Catalogue({folder_.string()}).fingerprint(), touched);
  EXPECT_NE(Catalogue(std::vector<RasterInfo>{}).fingerprint(), before);
}

}  // namespace
}  // namespace selenograph::dem
