// Tiles that are written to while they are read: what is answered and kept is of one file, the one that was catalogued.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <vector>

#include "dem/base/error.h"
#include "dem/catalogue/catalogue.h"
#include "dem/files/files.h"
#include "dem/gdal/geotiff_writer.h"
#include "dem/gdal/raster.h"
#include "dem/posts/post_source.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

std::string bytes_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// In place, as `rsync --inplace` does.
void write_onto(const std::string& path, const std::string& bytes) {
  std::fstream(path, std::ios::binary | std::ios::in | std::ios::out) << bytes;
}

timespec modified(const std::string& path) {
  struct stat s {};
  ::stat(path.c_str(), &s);
  return s.st_mtim;
}

void set_modified(const std::string& path, timespec time) {
  const timespec times[] = {time, time};
  ASSERT_EQ(::utimensat(AT_FDCWD, path.c_str(), times, 0), 0);
}

// Of one size, whatever its posts compress to.
std::string tiff_of(float height_m) {
  std::string bytes = geotiff_bytes({1, 20, 0.125, 0.125, 8, 8}, std::vector<float>(64, height_m), "height");
  bytes.resize(2048);
  return bytes;
}

// Other posts in as many bytes, under the old time of modification.
void forge(const std::string& path) {
  const timespec before = modified(path);
  std::string bytes = bytes_of(path);
  if (path.ends_with(".tif"))
    bytes = tiff_of(bytes == tiff_of(3) ? 5 : 3);
  else
    for (char& byte : bytes) byte = static_cast<char>(byte ^ 4);
  write_onto(path, bytes);
  set_modified(path, before);
}

template <typename Work>
std::string refusal(const Work& work) {
  try {
    work();
  } catch (const DataError& error) {
    return error.what();
  }
  return {};
}

bool has(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

std::vector<float> posts_of(Raster& raster) {
  std::vector<float> posts(64);
  raster.read(0, 0, 8, 8, posts.data());
  return posts;
}

constexpr const char* kVrt =
    "<VRTDataset rasterXSize=\"8\" rasterYSize=\"8\"><SRS>GEOGCS[\"Moon\",DATUM[\"Moon\",SPHEROID[\"Moon\",1737400,0]],"
    "PRIMEM[\"0\",0],UNIT[\"degree\",0.0174532925199433]]</SRS><GeoTransform>20, 0.125, 0, 1, 0, -0.125</GeoTransform>"
    "<VRTRasterBand dataType=\"Float32\" band=\"1\"><SimpleSource><SourceFilename relativeToVRT=\"1\">t.tif"
    "</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>";

class ChangingFiles : public ::testing::Test {
 protected:
  // Each with the file that holds its posts.
  std::map<std::string, std::string> rasters() const {
    std::ofstream(folder_ / "t.tif", std::ios::binary) << tiff_of(3);
    std::ofstream(folder_ / "v.vrt") << kVrt;
    test::write_float_tile(folder_.path(), "f", {1, 40, 8, 8, 8}, [](double lat, double) { return lat; });
    test::write_kaguya_tile(folder_ / "dem", 2, 60, 1, 8, [](double, double lon) { return lon; });
    std::map<std::string, std::string> found{{folder_ / "t.tif", folder_ / "t.tif"},
                                             {folder_ / "v.vrt", folder_ / "t.tif"},
                                             {folder_ / "f.lbl", folder_ / "f.img"}};
    for (const auto& entry : fs::directory_iterator(folder_ / "dem"))
      if (entry.path().extension() == ".lbl")
        found[entry.path().string()] = fs::path(entry.path()).replace_extension(".img").string();
    return found;
  }
  TemporaryFolder folder_;
};

TEST_F(ChangingFiles, ReadsNeverMixTwoVersions) {
  const auto all = rasters();
  ASSERT_EQ(all.size(), 4U);
  for (const auto& [path, data] : all) {
    const RasterInfo info = inspect_raster(path);
    Raster raster(info);
    const std::vector<float> before = posts_of(raster);
    EXPECT_EQ(posts_of(raster), before);
    forge(data);  // after the file was opened and, as it were, while it is read
    EXPECT_FALSE(raster.current()) << path;
    const std::string text = refusal([&] { posts_of(raster); });
    EXPECT_TRUE(has(text, "has changed") && has(text, "start again") && has(text, path.c_str())) << text;
    write_onto(data, bytes_of(data));
    EXPECT_TRUE(has(refusal([&] { Raster{info}; }), "has changed since it was catalogued")) << path;
  }
}

// A label that is newer than its data hides their time from the newest of both.
TEST_F(ChangingFiles, EachFileOfARasterCounts) {
  rasters();
  const std::string label = folder_ / "f.lbl", data = folder_ / "f.img";
  set_modified(data, {1000000000, 0});
  const RasterInfo info = inspect_raster(label);
  const std::uint64_t before = Catalogue(std::vector<std::string>{label}).fingerprint();
  forge(data);
  set_modified(data, {1100000000, 0});
  EXPECT_TRUE(has(refusal([&] { Raster{info}; }), "has changed"));
  EXPECT_NE(Catalogue(std::vector<std::string>{label}).fingerprint(), before);
}

// The clock that files get their times by stands still for some milliseconds.
TEST_F(ChangingFiles, ChangesRightAfterAnInspectionShow) {
  const std::string path = folder_ / "t.tif";
  rasters();
  for (int i = 0; i < 20; ++i) {
    write_onto(path, bytes_of(path));
    const RasterInfo info = inspect_raster(path);
    write_onto(path, bytes_of(path));
    EXPECT_TRUE(has(refusal([&] { Raster{info}; }), "has changed")) << i;
  }
}

// A tile that was repaired in place and then given its old time: nothing made of the old posts is taken for it.
TEST_F(ChangingFiles, ARepairedTileIsAnother) {
  for (const auto& [path, data] : rasters()) {
    const RasterInfo before = inspect_raster(path);
    const std::uint64_t fingerprint = Catalogue(std::vector<std::string>{path}).fingerprint();
    EXPECT_EQ(inspect_raster(path).stamp, before.stamp) << "unchanged";
    forge(data);
    const RasterInfo after = inspect_raster(path);
    EXPECT_EQ(after.bytes, before.bytes);
    EXPECT_EQ(after.modified_ns, before.modified_ns);
    EXPECT_NE(after.stamp, before.stamp) << path;
    EXPECT_NE(Catalogue(std::vector<std::string>{path}).fingerprint(), fingerprint) << path;
  }
}

// Another file under the old name: its inode tells, should the clock have stood still.
TEST_F(ChangingFiles, TheInodeIsPartOfAStamp) {
  const std::uint64_t stamp = stamp_of(FileState{100, 5, 7, 11});
  EXPECT_EQ(stamp_of(FileState{100, 5, 7, 11}), stamp);
  for (const FileState& other : {FileState{101, 5, 7, 11}, {100, 6, 7, 11}, {100, 5, 8, 11}, {100, 5, 7, 12}})
    EXPECT_NE(stamp_of(other), stamp);
}

TEST_F(ChangingFiles, OtherNamesAndPermissionsAreAChange) {
  rasters();
  const Catalogue catalogue(std::vector<std::string>{folder_ / "t.tif"});
  const PostSource source(catalogue, false, {});
  const auto posts = [&] {
    std::vector<float> heights(64);
    source.read(0, 0, 0, 8, 8, heights.data());
    return heights;
  };
  posts();
  const std::string path = folder_ / "t.tif";
  fs::rename(path, folder_ / "away.tif");
  fs::rename(folder_ / "away.tif", path);
  EXPECT_TRUE(has(refusal(posts), "t.tif: has changed"));
}

// Pyramids beside each other, one made before its tile changed and one after.
TEST_F(ChangingFiles, NothingOfAChangedFileIsCached) {
  const auto bumpy = [](double lat, double lon) { return std::round(300 * std::sin(lat * 300) * std::sin(lon * 200)); };
  test::write_kaguya_tile(folder_ / "tiles", 20, 1, 2, 2048, bumpy);
  std::string data;
  for (const auto& entry : fs::directory_iterator(folder_ / "tiles"))
    if (entry.path().extension() == ".img") data = entry.path().string();
  const std::string original = bytes_of(data);
  const timespec time = modified(data);
  const auto kept_in = [&](const std::string& cache) {
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder_ / cache))
      if (entry.is_regular_file()) files[entry.path().filename().string()] = bytes_of(entry.path().string());
    return files;
  };
  const auto terrain_in = [&](const std::string& cache) {
    return test::open_terrain(folder_ / "tiles", folder_ / cache);
  };
  const auto expect_bumps = [&](const PyramidTerrain& terrain) {
    for (const double lon : {1.5, 2.5}) EXPECT_NEAR(terrain.height(19.5, lon).height_m, bumpy(19.5, lon), 1e-6) << lon;
    terrain.wait_until_written();
  };
  const auto terrain = terrain_in("cache");
  EXPECT_NEAR(terrain->height(19.5, 1.5).height_m, bumpy(19.5, 1.5), 1e-6);
  terrain->wait_until_written();
  const auto before = kept_in("cache");
  write_onto(data, std::string(original.size(), '\1'));
  EXPECT_TRUE(has(refusal([&] { terrain->height(19.5, 2.5); }), "start again"));
  terrain->wait_until_written();
  EXPECT_EQ(kept_in("cache"), before);
  EXPECT_NEAR(terrain->height(19.5, 1.5).height_m, bumpy(19.5, 1.5), 1e-6) << "what was read before";
  write_onto(data, original);
  set_modified(data, time);
  EXPECT_TRUE(has(refusal([&] { terrain->height(19.5, 2.5); }), "start again"));
  expect_bumps(*terrain_in("cache"));
}

}  // namespace
}  // namespace selenograph::dem
