// A catalogue that is opened again finds what it would find the first time.
#include "dem/catalogue/saved_catalogue.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

#include "dem/base/error.h"
#include "dem/catalogue/catalogue.h"
#include "dem/files/folder_files.h"
#include "dem/gdal/geotiff_writer.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

// A tile of one degree, 8 x 8 posts, in Kaguya's format.
std::string tile_label(const std::string& image, double south, double west, const std::string& more = {}) {
  const auto line = [](const char* key, double v) { return fmt::format("{} = {:f}\r\n", key, v); };
  return "PDS_VERSION_ID = \"PDS3\"\r\nMISSION_NAME = SELENE\r\nRECORD_BYTES = 1024\r\n^IMAGE = " + image + "\r\n" +
         "OBJECT = IMAGE_MAP_PROJECTION\r\nMAP_PROJECTION_TYPE = \"SIMPLE CYLINDRICAL\"\r\nMAP_RESOLUTION = 8\r\n" +
         line("MAXIMUM_LATITUDE", south + 1) + line("MINIMUM_LATITUDE", south + 0.125) +
         line("WESTERNMOST_LONGITUDE", west) + line("EASTERNMOST_LONGITUDE", west + 0.875) +
         line("LINE_PROJECTION_OFFSET", 8 * (south + 1)) + line("SAMPLE_PROJECTION_OFFSET", -8 * west) +
         "END_OBJECT\r\nOBJECT = IMAGE\r\nLINES = 8\r\nLINE_SAMPLES = 8\r\nSAMPLE_TYPE = MSB_INTEGER\r\n" + more +
         "SAMPLE_BITS = 16\r\nEND_OBJECT\r\nEND\r\n";
}

// A polar stereographic map around the south pole, 8 x 8 posts.
std::string polar_label(const std::string& image) {
  return "PDS_VERSION_ID = \"PDS3\"\r\nINSTRUMENT_ID = LOLA\r\n^IMAGE = " + image +
         "\r\nOBJECT = IMAGE\r\nLINES = 8\r\nLINE_SAMPLES = 8\r\nSAMPLE_TYPE = LSB_INTEGER\r\nSAMPLE_BITS = 16\r\n"
         "SCALING_FACTOR = 0.5\r\nMISSING_CONSTANT = -32768\r\nEND_OBJECT\r\nOBJECT = IMAGE_MAP_PROJECTION\r\n"
         "MAP_PROJECTION_TYPE = \"POLAR STEREOGRAPHIC\"\r\nMAP_SCALE = 1000 <m/pixel>\r\nCENTER_LATITUDE = -90\r\n"
         "CENTER_LONGITUDE = 0\r\nLINE_PROJECTION_OFFSET = 3.5\r\nSAMPLE_PROJECTION_OFFSET = "
         "3.5\r\nEND_OBJECT\r\nEND\r\n";
}

constexpr const char* kVrt =
    "<VRTDataset rasterXSize=\"8\" rasterYSize=\"8\"><SRS>GEOGCS[\"Moon\",DATUM[\"Moon\",SPHEROID[\"Moon\",1737400,0]],"
    "PRIMEM[\"0\",0],UNIT[\"degree\",0.0174532925199433]]</SRS><GeoTransform>40, 0.125, 0, 1, 0, -0.125</GeoTransform>"
    "<VRTRasterBand dataType=\"Int16\" band=\"1\"><SimpleSource><SourceFilename relativeToVRT=\"1\">sources/s.tif"
    "</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>";

// All that a catalogue says.
std::string text_of(const Catalogue& c) {
  std::string text = fmt::format("{:016x}\n", c.fingerprint());
  for (const RasterInfo& r : c.rasters()) {
    text += fmt::format("{} {} {} {} {} {} {} {} {} {} {} {} ", r.path, r.name, r.format, r.width, r.height,
                        r.posts_per_degree, r.post_spacing_m, r.footprint.south_deg, r.footprint.north_deg,
                        r.footprint.west_deg, r.footprint.east_deg, r.wraps_longitude);
    text += fmt::format("{} ", r.synthetic);
    text += fmt::format("{} {} {} {} {} {} {} {} {} ", r.lattice_level.value_or(-1), r.datum, r.quantisation_m,
                        r.void_value.value_or(1e99), r.bytes, r.modified_ns, r.stamp, r.on_network, r.damage);
    if (const auto* g = std::get_if<GeographicGrid>(&r.grid))
      text += fmt::format("{} {} {} {}\n", g->first_lat_deg, g->first_lon_deg, g->lat_posts_per_degree,
                          g->lon_posts_per_degree);
    if (const auto* g = std::get_if<PlaneGrid>(&r.grid))
      text += fmt::format("{} {} {} {} {} {} {} {}\n", static_cast<int>(g->plane.projection), g->plane.lat_deg,
                          g->plane.lon_deg, g->plane.standard_parallel_deg, g->plane.scale, g->first_x_m, g->first_y_m,
                          g->spacing_m);
  }
  for (const CatalogueProblem& p : c.problems())
    text += fmt::format("{}: {} {} {}\n", p.path, p.what, p.located, p.unrelated);
  return text;
}

class SavedCatalogueTest : public ::testing::Test {
 protected:
  SavedCatalogueTest() {
    fs::create_directory(folder_ / "dem");
    options_.cache_dir = (folder_ / "cache").string();
    options_.log = [this](const std::string& text) { log_.push_back(text); };
    options_.settling = {};
  }

  std::string path(const std::string& name) const { return (folder_ / "dem" / name).string(); }
  // A file whose stamp is another one than before: clocks of file systems step slowly.
  void put(const std::string& name, const std::string& bytes) const {
    fs::create_directories(fs::path(path(name)).parent_path());
    const std::uint64_t before = stamp_of(path(name))->hash;
    do std::ofstream(path(name), std::ios::binary | std::ios::trunc) << bytes;
    while (stamp_of(path(name))->hash == before);
  }
  void put_tile(const std::string& stem, double west, const char* data = ".img") const {
    put(stem + ".lbl", tile_label(fmt::format("\"{}{}\"", fs::path(stem).filename().string(), data), 0, west));
    put(stem + data, std::string(128, '\1'));
  }
  void put_tiff(const std::string& name, double west) const {
    const std::vector<float> heights(64, 3.F);
    put(name, geotiff_bytes({1, west, 0.125, 0.125, 8, 8}, heights, "height"));
  }

  // Of everything, usable or not.
  void put_all() const {
    put_tile("a/one", 10);
    put_tile("a/Upper", 11, ".IMG");
    put("a/attached.img", [] {
      std::string text = tile_label("2", 0, 12);
      text.resize(1024, ' ');
      return text + std::string(128, '\1');
    }());
    put("a/its_label.lbl", tile_label("\"named.img\"", 0, 13));
    put("a/named.img", std::string(128, '\1'));
    put("a/polar.lbl", polar_label("\"polar.img\""));
    put("a/polar.img", std::string(128, '\2'));
    put_tiff("site/s1.tif", 20);
    put_tiff("site/sources/s.tif", 40);
    put("site/mosaic.vrt", kVrt);
    put("scene.lbl", "PDS_VERSION_ID = PDS3\n^IMAGE = \"scene.dat\"\nOBJECT = IMAGE\nLINES = 3\nEND_OBJECT\nEND\n");
    put("notes.txt", "nothing");
    // Problems.
    put("garbage.lbl", "\x01\x02\x03");
    put_tile("short", 14);
    put("short.img", std::string(127, '\1'));
    put("gone.lbl", tile_label("\"gone.img\"", 0, 15));
    put("scaled.lbl", tile_label("\"scaled.img\"", 0, 16, "SCALING_FACTOR = 1e308\r\n"));
    put("scaled.img", std::string(128, '\1'));
    put("lonely.img", "pixels without a label");
    put("empty.tif", "");
  }
  static constexpr std::size_t kUsable = 7, kOtherProducts = 1, kReadAlways = 6;  // what can't be used, and a VRT

  Catalogue plain() const { return Catalogue(std::vector<std::string>{(folder_ / "dem").string()}); }
  Catalogue saved() const { return Catalogue(std::vector<std::string>{(folder_ / "dem").string()}, options_); }
  fs::path file() const {
    for (const auto& entry : fs::directory_iterator(folder_ / "cache" / "catalogue"))
      if (entry.path().extension() == ".sgc") return entry.path();
    return {};
  }
  static std::string bytes_of(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  const test::TemporaryFolder own_;
  const fs::path folder_ = own_.path();
  CatalogueOptions options_;
  std::vector<std::string> log_;
};

TEST_F(SavedCatalogueTest, UnchangedFilesAreNotReread) {
  put_all();
  const Catalogue expected = plain(), first = saved();
  EXPECT_EQ(text_of(first), text_of(expected));
  EXPECT_EQ(first.rasters().size(), kUsable + 2);  // and the VRT, and what is damaged where it is known
  EXPECT_EQ(first.problems().size(), 6U);
  EXPECT_EQ(first.inspected(), kUsable + kOtherProducts + kReadAlways);
  const std::string bytes = bytes_of(file());
  const auto written = fs::last_write_time(file());
  for (int i = 0; i < 3; ++i) {
    const Catalogue again = saved();
    EXPECT_EQ(text_of(again), text_of(expected));
    EXPECT_EQ(again.inspected(), kReadAlways);
  }
  EXPECT_EQ(fs::last_write_time(file()), written) << "nothing new: nothing is written";
  EXPECT_EQ(bytes_of(file()), bytes);
  EXPECT_TRUE(log_.empty()) << log_[0];
}

TEST_F(SavedCatalogueTest, ChangesAreDetected) {
  put_all();
  saved();
  std::string same_size = tile_label("\"one.img\"", 0, 10);
  same_size.replace(same_size.find("SELENE"), 6, "APOLLO");
  const auto modified = fs::last_write_time(path("a/one.lbl"));
  const std::vector<std::pair<const char*, std::function<void()>>> changes = {
      {"a label of the same size and age",
       [&] {
         put("a/one.lbl", same_size);
         fs::last_write_time(path("a/one.lbl"), modified);
       }},
      {"a label", [&] { put("a/one.lbl", tile_label("\"one.img\"", 5, 10)); }},
      {"a truncated image", [&] { fs::resize_file(path("a/one.img"), 100); }},
      {"a longer image", [&] { put("a/one.img", std::string(130, '\1')); }},
      {"a time of modification",
       [&] {
         fs::last_write_time(path("a/Upper.IMG"), fs::last_write_time(path("a/Upper.IMG")) - std::chrono::hours(1));
       }},
      {"an image of another name than its label's", [&] { put("a/named.img", std::string(140, '\1')); }},
      {"an image of another name that is gone", [&] { fs::remove(path("a/named.img")); }},
      {"an image in the case that the label asks for",
       [&] {
         put("a/twice.lbl", tile_label("\"twice.img\"", 0, 17));
         put("a/TWICE.IMG", std::string(128, '\1'));
         saved();
         put("a/twice.img", std::string(150, '\1'));
       }},
      {"a tile that came", [&] { put_tile("b/new", 18); }},
      {"a tile that went", [&] { fs::remove(path("a/Upper.lbl")), fs::remove(path("a/Upper.IMG")); }},
      {"a folder that went", [&] { fs::remove_all(path("b")); }},
      {"a site's file", [&] { put_tiff("site/s1.tif", 22); }},
      {"what lies beside a site's file",
       [&] {
         put("site/s1.tif.aux.xml",
             "<PAMDataset><PAMRasterBand band=\"1\"><NoDataValue>7</NoDataValue></PAMRasterBand></PAMDataset>");
       }},
      {"a source of a VRT", [&] { put("site/sources/s.tif", "no more"); }},
      {"a label that is mended", [&] { put_tile("garbage", 19); }},
      {"the image of a label", [&] { put("gone.img", std::string(128, '\1')); }},
      {"the label of an image", [&] { put_tile("lonely", 21); }},
      {"a scene that is a map now", [&] { put_tile("scene", 23); }},
  };
  for (const auto& [what, change] : changes) {
    const std::string before = text_of(plain());
    change();
    const std::string expected = text_of(plain());
    EXPECT_NE(expected, before) << what << " changes nothing";
    EXPECT_EQ(text_of(saved()), expected) << what;
    EXPECT_EQ(text_of(saved()), expected) << what << ", the second time";
  }
  EXPECT_TRUE(log_.empty()) << log_[0];
}

TEST_F(SavedCatalogueTest, RecentChangesAreReread) {
  put_tile("a/one", 10);
  options_.settling = std::chrono::hours(1);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(saved().inspected(), 1U);
  options_.settling = {};
  EXPECT_EQ(saved().inspected(), 1U);
  EXPECT_EQ(saved().inspected(), 0U);
}

TEST_F(SavedCatalogueTest, DifferentPathsHaveDifferentFiles) {
  put_tile("a/one", 10);
  put_tile("b/two", 11);
  const auto opened = [&](const std::vector<std::string>& paths) {
    const Catalogue c(paths, options_);
    EXPECT_EQ(text_of(c), text_of(Catalogue(paths)));
    return c.inspected();
  };
  for (const std::size_t expected : {1U, 0U}) {
    EXPECT_EQ(opened({path("a")}), expected);
    EXPECT_EQ(opened({path("b")}), expected);
    EXPECT_EQ(opened({path("b"), path("a")}), 2 * expected);
    EXPECT_EQ(opened({path("a/one.lbl")}), expected);
    EXPECT_EQ(opened({path("b/two.img")}), expected);
  }
  // The same words, said in another folder.
  const fs::path here = fs::current_path();
  fs::create_directories(path("c/a"));
  fs::copy(path("b"), path("c/a"), fs::copy_options::recursive);
  for (const std::size_t expected : {1U, 0U})
    for (const char* folder : {"", "c"}) {
      fs::current_path(path(folder));
      EXPECT_EQ(opened({"a"}), expected);
      fs::current_path(here);
    }
}

TEST_F(SavedCatalogueTest, ANamedFileMustStayUsable) {
  put_tile("a/one", 10);
  saved();
  put("a/one.lbl", "PDS_VERSION_ID = PDS3\n^IMAGE = \"one.img\"\nOBJECT = IMAGE\nLINES = 3\nEND_OBJECT\nEND\n");
  const std::vector<std::string> named{path("a/one.lbl")};
  for (int i = 0; i < 2; ++i) EXPECT_THROW(Catalogue(named, options_), DataError);
  put_tile("a/one", 10);
  EXPECT_EQ(Catalogue(named, options_).rasters().size(), 1U);
  fs::remove(path("a/one.img"));
  EXPECT_THROW(Catalogue(named, options_), DataError);
}

TEST_F(SavedCatalogueTest, DamagedFileIsReplaced) {
  put_tile("one", 10);
  put("polar.lbl", polar_label("\"polar.img\""));
  put("polar.img", std::string(128, '\2'));
  const std::string expected = text_of(plain());
  saved();
  const fs::path where = file();
  const std::string right = bytes_of(where);
  const auto check = [&](const std::string& bytes, const char* says, const std::string& what) {
    std::ofstream(where, std::ios::binary | std::ios::trunc) << bytes;
    log_.clear();
    const Catalogue c = saved();
    EXPECT_EQ(text_of(c), expected) << what;
    EXPECT_EQ(c.inspected(), 2U) << what;
    ASSERT_EQ(log_.size(), 1U) << what;
    EXPECT_NE(log_[0].find(says), std::string::npos) << what << ": " << log_[0];
    EXPECT_EQ(bytes_of(where), right) << what;
  };
  for (std::size_t i = 0; i < right.size(); i += i < 40 ? 1 : 7) {
    std::string bytes = right;
    bytes[i] = static_cast<char>(bytes[i] ^ 0x41);
    // What the four bytes hold that nobody uses is nobody's matter.
    if (i < 12 || i >= 16) check(bytes, "", fmt::format("byte {}", i));
  }
  for (std::size_t size = 0; size < right.size(); size += 11) check(right.substr(0, size), "truncated", "truncated");
  check(right + "more", "truncated", "longer");
  std::string old = right;
  old[8] = 0;
  check(old, "another version", "old");
  check(std::string(1 << 20, '\xff'), "damaged", "not one at all");
  EXPECT_EQ(saved().inspected(), 0U);
}

// The checksum is right, and yet what it says isn't what is asked for.
TEST_F(SavedCatalogueTest, FileOfOtherPathsIsDetected) {
  put_tile("a/one", 10);
  put_tile("b/two", 11);
  const Catalogue a({path("a")}, options_);
  const fs::path of_a = file();
  const std::string bytes = bytes_of(of_a);
  fs::remove(of_a);
  const std::vector<std::string> b_paths{path("b")};
  const Catalogue b(b_paths, options_);
  std::ofstream(file(), std::ios::binary | std::ios::trunc) << bytes;
  EXPECT_EQ(text_of(Catalogue(b_paths, options_)), text_of(b));
  ASSERT_EQ(log_.size(), 1U);
  EXPECT_NE(log_[0].find("other files"), std::string::npos) << log_[0];
}

TEST_F(SavedCatalogueTest, UnwritableFolderIsHarmless) {
  put_tile("one", 10);
  std::ofstream(folder_ / "file") << "no folder";
  options_.cache_dir = (folder_ / "file" / "cache").string();
  for (int i = 0; i < 2; ++i) {
    log_.clear();
    const Catalogue c = saved();
    EXPECT_EQ(text_of(c), text_of(plain()));
    EXPECT_EQ(c.inspected(), 1U);
    ASSERT_EQ(log_.size(), 1U);
    EXPECT_NE(log_[0].find(options_.cache_dir), std::string::npos) << log_[0];
  }
}

TEST_F(SavedCatalogueTest, SeveralOpeningsAtOnceLeaveOneWhole) {
  for (int i = 0; i < 20; ++i) put_tile(fmt::format("t{}", i), 10 + i);
  const std::string expected = text_of(plain());
  options_.log = {};
  std::vector<std::string> found(8);
  {
    std::vector<std::jthread> threads;
    for (std::string& text : found)
      threads.emplace_back([&] {
        for (int i = 0; i < 5; ++i) {
          text = text_of(saved());
          if (text != expected) return;
          std::error_code ignored;
          fs::remove_all(folder_ / "cache" / "catalogue", ignored);
        }
      });
  }
  for (const std::string& text : found) EXPECT_EQ(text, expected);
  saved();
  EXPECT_EQ(saved().inspected(), 0U);
  for (const auto& entry : fs::directory_iterator(folder_ / "cache" / "catalogue"))
    EXPECT_EQ(entry.path().extension(), ".sgc") << entry.path();
}

TEST_F(SavedCatalogueTest, LeftoversOfKilledProcessesAreRemoved) {
  put_tile("one", 10);
  const fs::path left = folder_ / "cache" / "catalogue" / "0123456789abcdef.sgc.tmp-999999999-0";
  fs::create_directories(left.parent_path());
  std::ofstream(left) << "half";
  saved();
  EXPECT_FALSE(fs::exists(left));
}

}  // namespace
}  // namespace selenograph::dem
