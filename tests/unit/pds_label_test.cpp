// Labels only: syntax, and where each dialect puts its first post.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "dem/base/error.h"
#include "dem/files/pds_image.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;
using test::shared_data;

// A label of 30 x 30 posts at 10 per degree whose lines a test can replace.
struct LabelText {
  std::string pointer = "^IMAGE = (\"tile.img\", 1 <BYTES>)";
  std::string map =
      "MAP_RESOLUTION = 10.0 <pixel/deg>\nMAXIMUM_LATITUDE = 27.0\nMINIMUM_LATITUDE = 24.1\nWESTERNMOST_LONGITUDE = "
      "3.0\n"
      "EASTERNMOST_LONGITUDE = 5.9\nLINE_PROJECTION_OFFSET = 270.0\nSAMPLE_PROJECTION_OFFSET = -30.0\n";
  std::string projection = "\"SIMPLE CYLINDRICAL\"";
  std::string sample = "SAMPLE_TYPE = MSB_INTEGER\nSAMPLE_BITS = 16\n";
  std::string image = "DUMMY = -9999\nUNIT = \"m\"\n";

  std::string str() const {
    return "PDS_VERSION_ID = PDS3\n" + pointer +
           "\nOBJECT = IMAGE_MAP_PROJECTION\nMAP_PROJECTION_TYPE = " + projection + "\n" + map +
           "END_OBJECT\nOBJECT = IMAGE\nLINES = 30\nLINE_SAMPLES = 30\n" + sample + image + "END_OBJECT\nEND\n";
  }
};

class Product {
 public:
  RawImage describe(const LabelText& text, std::size_t data_bytes = 1800, const std::string& data_name = "tile.img") {
    std::ofstream(folder_ / data_name) << std::string(data_bytes, '\0');
    std::ofstream(folder_ / "tile.lbl") << text.str();
    const std::string path = folder_ / "tile.lbl";
    return describe_pds_image(read_pds_label(path), path);
  }
  std::string complaint(const LabelText& text, std::size_t data_bytes = 1800) {
    try {
      describe(text, data_bytes);
    } catch (const DataError& e) {
      EXPECT_EQ(e.file(), folder_ / "tile.lbl");
      return e.what();
    }
    return "no complaint";
  }

 private:
  test::TemporaryFolder folder_;
};

GeographicGrid geographic(const RawImage& image) { return std::get<GeographicGrid>(image.grid); }

TEST(PdsLabel, ReadsEveryFormOfValue) {
  const PdsObject label = parse_pds_label(
      "/* comment */\r\nPDS_VERSION_ID = PDS3\r\nA = \"two\r\n lines\" /* tail */\r\nB = (1, 2.5 <m>, 'x y')\r\n"
      "C = {\"p, q\", r}\r\nD = +1737400.\r\nE = 16#FF#\r\nF = N/A <deg>\r\n^IMAGE = (\"x.img\",12)\r\n"
      "G = long_-\r\n    word\r\nH = W/m**2/micron/sr /* open comment\r\nGROUP = inner\r\n a_b = "
      "7\r\nEnd_Group\r\nEnd\r\n\x01\x02",
      "t");
  EXPECT_EQ(label.find("a")->text(), "two\r\n lines");
  EXPECT_EQ(label.find("B")->number(1), 2.5);
  EXPECT_EQ(label.find("B")->unit, "m");
  EXPECT_EQ(label.find("B")->items.at(2), "x y");
  EXPECT_EQ(label.find("C")->items, (std::vector<std::string>{"p, q", "r"}));
  EXPECT_EQ(label.find("D")->number(), 1737400.0);
  EXPECT_EQ(label.find("E")->number(), 255.0);
  EXPECT_EQ(label.find("F")->number(), std::nullopt);
  EXPECT_EQ(label.find("^image")->number(1), 12.0);
  EXPECT_EQ(label.find("G")->text(), "long_word");
  EXPECT_EQ(label.find("H")->text(), "W/m**2/micron/sr");
  ASSERT_TRUE(label.find_object("INNER"));
  EXPECT_EQ(label.find_deep("A_B")->number(), 7.0);
  EXPECT_EQ(label.find("A_B"), nullptr);
}

TEST(PdsLabel, GarbageIsAnErrorThatNamesTheFile) {
  for (const char* text :
       {"", "hello world", "\x89PNG\r\n\x1a\n", "A = 1\n", "PDS_VERSION_ID = \"PDS3", "PDS_VERSION_ID = (1, 2",
        "PDS_VERSION_ID = PDS3\nOBJECT = IMAGE\nLINES = 3\n", "PDS_VERSION_ID = PDS3\nEND_OBJECT\n",
        "PDS_VERSION_ID = PDS3\nOBJECT = IMAGE\nEND\n", "PDS_VERSION_ID =", "PDS_VERSION_ID = PDS3\nA = <\n"}) {
    try {
      parse_pds_label(text, "folder/bad.lbl");
      FAIL() << "accepted: " << text;
    } catch (const DataError& e) {
      EXPECT_EQ(e.file(), "folder/bad.lbl") << text;
    }
  }
  std::string deep = "PDS_VERSION_ID = PDS3\n";
  for (int i = 0; i < 100000; ++i) deep += "OBJECT = X\n";
  EXPECT_THROW(parse_pds_label(deep, "deep"), DataError);
  EXPECT_THROW(parse_pds_label("PDS_VERSION_ID = " + std::string(100000, '('), "deep"), DataError);
  EXPECT_THROW(read_pds_label("/no/such/file.lbl"), DataError);
  EXPECT_THROW(read_pds_label("/"), DataError);
}

TEST(PdsLabel, RealLabelsOfOtherProductsParse) {
  const std::string folder = shared_data("labels");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  int maps = 0, others = 0;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    const PdsObject label = read_pds_label(entry.path().string());
    EXPECT_TRUE(label.find_object("IMAGE")) << entry.path();
    (describes_map(label) ? maps : others) += 1;
  }
  EXPECT_EQ(others, 4);  // Level 2 scenes
  EXPECT_EQ(maps, 3);    // two LOLA labels, one MI mosaic
}

TEST(PdsLabel, CornersDecideWhatOffsetsMean) {
  struct Case {
    const char* what;
    const char* map;
    double lat, lon;
  };
  const char* posts =
      "MAXIMUM_LATITUDE=27.0\nMINIMUM_LATITUDE=24.1\nWESTERNMOST_LONGITUDE=3.0\nEASTERNMOST_LONGITUDE=5.9\n";
  const char* edges = "MAXIMUM_LATITUDE=27\nMINIMUM_LATITUDE=24\nWESTERNMOST_LONGITUDE=3\nEASTERNMOST_LONGITUDE=6\n";
  const char* corners =
      "UPPER_LEFT_LATITUDE=27.0\nLOWER_LEFT_LATITUDE=24.1\nUPPER_LEFT_LONGITUDE=3.0\nUPPER_RIGHT_LONGITUDE=5.9\n";
  const Case cases[] = {
      {"posts, matching", "LINE_PROJECTION_OFFSET=270\nSAMPLE_PROJECTION_OFFSET=-30\n", 27, 3},
      {"posts, mirrored", "LINE_PROJECTION_OFFSET=-270\nSAMPLE_PROJECTION_OFFSET=30\n", 27, 3},
      {"posts, 1-based", "LINE_PROJECTION_OFFSET=271\nSAMPLE_PROJECTION_OFFSET=-29\n", 27, 3},
      {"posts, no offsets", "", 27, 3},
      {"posts, empty offsets", "LINE_PROJECTION_OFFSET=0\nSAMPLE_PROJECTION_OFFSET=0\n", 27, 3},
      {"edges, area", "LINE_PROJECTION_OFFSET=269.5\nSAMPLE_PROJECTION_OFFSET=-30.5\n", 26.95, 3.05},
      {"edges, area, 1-based", "LINE_PROJECTION_OFFSET=270.5\nSAMPLE_PROJECTION_OFFSET=-29.5\n", 26.95, 3.05},
      {"edges, but posts on the corner", "LINE_PROJECTION_OFFSET=270\nSAMPLE_PROJECTION_OFFSET=-30\n", 27, 3},
      {"edges, no offsets", "", 26.95, 3.05},
      {"upper left", "LINE_PROJECTION_OFFSET=270\nSAMPLE_PROJECTION_OFFSET=30\n", 27, 3},
      {"offsets alone", "LINE_PROJECTION_OFFSET=270\nSAMPLE_PROJECTION_OFFSET=-30\n", 27, 3},
  };
  Product product;
  for (const Case& c : cases) {
    const std::string what = c.what;
    const char* bounds = what.starts_with("edges") ? edges : what.starts_with("posts") ? posts : corners;
    LabelText text;
    text.map = std::string("MAP_RESOLUTION=10\n") + c.map + (what == "offsets alone" ? "" : bounds);
    const GeographicGrid g = geographic(product.describe(text));
    EXPECT_NEAR(g.first_lat_deg, c.lat, 1e-12) << what;
    EXPECT_NEAR(g.first_lon_deg, c.lon, 1e-12) << what;
  }
  LabelText nonsense;
  nonsense.map = std::string("MAP_RESOLUTION=10\nLINE_PROJECTION_OFFSET=270\nSAMPLE_PROJECTION_OFFSET=777\n") + posts;
  EXPECT_NE(product.complaint(nonsense).find("contradict"), std::string::npos);
  LabelText wrong;
  wrong.map = std::string("MAP_RESOLUTION=20\nLINE_PROJECTION_OFFSET=270\nSAMPLE_PROJECTION_OFFSET=-30\n") + posts;
  EXPECT_NE(product.complaint(wrong).find("contradict"), std::string::npos);
}

TEST(PdsLabel, PrefersResolutionToARoundedScale) {
  Product product;
  LabelText both;
  both.map += "MAP_SCALE = 3.03 <km/pixel>\n";
  EXPECT_EQ(geographic(product.describe(both)).lat_posts_per_degree, 10);
  LabelText scale;
  scale.map.replace(scale.map.find("MAP_RESOLUTION"), std::string("MAP_RESOLUTION = 10.0 <pixel/deg>").size(),
                    "MAP_SCALE = 3032.34 <m/pixel>");
  EXPECT_EQ(geographic(product.describe(scale)).lat_posts_per_degree, 10);
}

TEST(PdsLabel, SyntheticTerrainIsToldByItsDataSet) {
  Product product;
  LabelText text;
  EXPECT_FALSE(product.describe(text).synthetic);
  text.pointer += "\nDATA_SET_ID = \"SYNTHETIC-SELENOGRAPH-TERRAIN\"";
  EXPECT_TRUE(product.describe(text).synthetic);
}

TEST(PdsLabel, PointersAndFiles) {
  Product product;
  LabelText text;
  text.pointer = "RECORD_BYTES = 60\n^IMAGE = (\"TILE.IMG\", 3)";  // the file on disk is tile.img
  const RawImage image = product.describe(text, 1920);
  EXPECT_EQ(image.first_byte, 120u);
  EXPECT_EQ(fs::path(image.data_path).filename(), "tile.img");
  EXPECT_NE(product.complaint(text, 1919).find("truncated"), std::string::npos);
  text.pointer = "^IMAGE = (\"tile.img\", 121 <BYTES>)";
  EXPECT_EQ(product.describe(text, 1920).first_byte, 120u);
  text.pointer = "^IMAGE = \"other.img\"";
  EXPECT_NE(product.complaint(text).find("other.img is missing"), std::string::npos);
  text.pointer = "^IMAGE = (\"tile.img\", 3)";
  EXPECT_NE(product.complaint(text).find("RECORD_BYTES"), std::string::npos);
  text.pointer = "RECORD_BYTES = 536870912\n^IMAGE = (\"tile.img\", 34359738369)";  // 2^64 bytes
  EXPECT_NE(product.complaint(text).find("^IMAGE"), std::string::npos);
  text.pointer = "^IMAGE = (\"tile.img\", -5 <BYTES>)";
  EXPECT_NE(product.complaint(text).find("^IMAGE"), std::string::npos);
  EXPECT_NE(product.complaint(LabelText{}, 1799).find("tile.img is truncated"), std::string::npos);
}

// What is there and can't be read is no default: heights would be wrong, and nobody would know.
TEST(PdsLabel, ScaleOffsetAndRadiusAreReadOrRefused) {
  Product product;
  const auto with = [&](const std::string& line) {
    LabelText text;
    text.image = line;
    return text;
  };
  EXPECT_EQ(product.describe(with("SCALING_FACTOR = 5.0D-01\nOFFSET = \"N/A\"\n")).scale, 0.5);
  EXPECT_EQ(product.describe(with("SCALING_FACTOR = 0.5 <m/DN>\nUNIT = METER\n")).scale, 0.5);
  EXPECT_EQ(product.describe(with("OFFSET = 1737.4 <km>\nUNIT = \"m\"\n")).offset, 1737400);
  EXPECT_EQ(product.describe(with("OFFSET = 1737.4 <km>\nUNIT = KILOMETER\n")).offset, 1737.4);
  EXPECT_EQ(product.describe(with("OFFSET = 1737400 <m>\nUNIT = \"km\"\n")).offset, 1737.4);
  EXPECT_EQ(product.describe(with("OFFSET = 1737.4\nUNIT = METER\n")).offset, 1737400) << "the radius in kilometres";
  EXPECT_EQ(product.describe(with("OFFSET = 1737400.\nUNIT = KILOMETER\n")).offset, 1737.4);
  EXPECT_EQ(product.describe(with("OFFSET = 1000\nUNIT = METER\n")).offset, 1000);
  for (const char* line : {"SCALING_FACTOR = HALF", "SCALING_FACTOR = nan", "OFFSET = \"1737,4\"", "BANDS = one",
                           "OFFSET = 1737.4 <mile>", "SCALING_FACTOR = 1 <s>"}) {
    const std::string said = product.complaint(with(std::string(line) + "\n"));
    EXPECT_NE(said.find(std::string(line).substr(0, std::string(line).find(' '))), std::string::npos) << said;
  }
  LabelText radius;
  radius.map += "A_AXIS_RADIUS = 1737400 <m>\n";
  EXPECT_EQ(product.complaint(radius), "no complaint");
  radius.map += "CENTER_LONGITUDE = east\n";
  EXPECT_NE(product.complaint(radius).find("CENTER_LONGITUDE"), std::string::npos);
}

TEST(PdsLabel, RejectsUnsupportedLabels) {
  Product product;
  const auto with_map = [&](const std::string& line) {
    LabelText text;
    text.map += line;
    return product.complaint(text);
  };
  EXPECT_NE(with_map("A_AXIS_RADIUS = 3396.0 <km>\n").find("3396000.0"), std::string::npos);
  EXPECT_NE(with_map("A_AXIS_RADIUS = 1737.4\nB_AXIS_RADIUS = 1737.4\nC_AXIS_RADIUS = 1736.0\n").find("1736000.0"),
            std::string::npos);
  EXPECT_NE(with_map("A_AXIS_RADIUS = 1738.1 <km>\nB_AXIS_RADIUS = 1737.4 <km>\n").find("1738100.0"),
            std::string::npos);
  EXPECT_EQ(with_map("TARGET_NAME = \"MOON\"\n"), "no complaint");
  EXPECT_NE(with_map("TARGET_NAME = MERCURY\n").find("MERCURY"), std::string::npos);
  EXPECT_NE(with_map("MAP_PROJECTION_ROTATION = 90\n").find("rotated"), std::string::npos);
  EXPECT_NE(with_map("POSITIVE_LONGITUDE_DIRECTION = \"WEST\"\n").find("west"), std::string::npos);
  LabelText sinusoidal;
  sinusoidal.projection = "SINUSOIDAL";
  EXPECT_NE(product.complaint(sinusoidal).find("SINUSOIDAL"), std::string::npos);
  LabelText radiance;
  radiance.image = "UNIT = \"W/m**2/micron/sr\"\n";
  EXPECT_NE(product.complaint(radiance).find("none of those in which heights are read"), std::string::npos);
  LabelText bands;
  bands.image = "BANDS = 9\n";
  EXPECT_NE(product.complaint(bands).find("BANDS"), std::string::npos);
}

// LOLA's polar products: exact metres per pixel, and offsets that are half a pixel off in some releases.
TEST(PdsLabel, PolarProductsAreSymmetric) {
  Product product;
  for (const char* offset : {"14.5", "15", "15.5"}) {
    LabelText text;
    text.projection = "\"POLAR STEREOGRAPHIC\"";
    text.map = fmt::format(
        "CENTER_LATITUDE = -90\nCENTER_LONGITUDE = 0\nMAP_RESOLUTION = 1516.17\nMAP_SCALE = 20 <m/pix>\n"
        "LINE_PROJECTION_OFFSET = {0}\nSAMPLE_PROJECTION_OFFSET = {0}\n",
        offset);
    const auto g = std::get<PlaneGrid>(product.describe(text).grid);
    EXPECT_EQ(g.plane, (MapPlane{MapProjection::stereographic, -90}));
    EXPECT_EQ(g.spacing_m, 20);
    EXPECT_EQ(g.first_x_m, -290);
    EXPECT_EQ(g.first_y_m, 290);
  }
}

}  // namespace
}  // namespace selenograph::dem
