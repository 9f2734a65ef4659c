// DEM files that would take all memory, wait for ever or divide by zero are named and left out, whoever opens them.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "dem/base/error.h"
#include "dem/catalogue/catalogue.h"
#include "dem/gdal/raster.h"
#include "dem/gdal/remote_names.h"
#include "dem/terrain/pyramid_terrain.h"
#include "dem/value_maps/value_map.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;

constexpr const char* kMoonDegrees =
    R"(GEOGCS["Moon",DATUM["Moon",SPHEROID["Moon",1737400,0]],PRIMEM["Reference",0],UNIT["degree",0.0174532925199433]])";
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

class RefusedFiles : public ::testing::Test {
 protected:
  std::string file(const std::string& name) const { return folder_ / name; }
  std::string put(const std::string& name, const std::string& text) const {
    std::ofstream(file(name), std::ios::binary) << text;
    return file(name);
  }

  // Why a file is refused; empty: it isn't. The same by itself and in its folder, where it is a problem of its name and
  // the others are used.
  std::string refusal(const std::string& path) const {
    std::string why;
    try {
      inspect_raster(path);
    } catch (const DataError& e) {
      EXPECT_EQ(e.file(), path);
      why = e.what_is_wrong();
    }
    const Catalogue all({folder_.path()});
    EXPECT_TRUE(all.find(good_));
    EXPECT_EQ(all.find(path).has_value(), why.empty()) << why;
    EXPECT_EQ(all.problems().size(), why.empty() ? 0U : 1U);
    for (const CatalogueProblem& p : all.problems()) {
      EXPECT_EQ(p.path, path);
      EXPECT_EQ(p.what, why);
    }
    return why;
  }

  test::TemporaryFolder folder_;
  std::string good_ = test::write_kaguya_tile(folder_.path(), 12, 0, 1, 16, [](double, double) { return 100.0; });
};

#define EXPECT_REFUSED(path, text)                                   \
  {                                                                  \
    const std::string why = refusal(path);                           \
    EXPECT_NE(why.find(text), std::string::npos) << "said: " << why; \
  }

// A GeoTIFF in degrees by its tags, as no writer would make it. Its blocks are not in the file: they read as zeros.
struct Tiff {
  std::uint32_t width = 16, height = 16, block_width = 16, block_height = 16;
  std::uint32_t compression = 8;  // deflate
  bool strips = false;
  std::vector<double> transform = {0.0625, 0, 0, 30, 0, -0.0625, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1};
};

template <typename T>
std::string bytes_of(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

std::string tiff(const Tiff& t) {
  const std::uint32_t across = t.strips ? 1 : (t.width + t.block_width - 1) / t.block_width;
  const std::vector<std::uint32_t> none(across * ((t.height + t.block_height - 1) / t.block_height), 0);
  const std::vector<std::uint16_t> keys = {
      1,    1, 0, 9,    1024, 0, 1, 2,    1025, 0, 1, 1,     2048, 0,     1, 32767, 2050, 0,     1, 32767,
      2052, 0, 1, 9001, 2054, 0, 1, 9102, 2056, 0, 1, 32767, 2057, 34736, 1, 0,     2058, 34736, 1, 1};
  struct Tag {
    std::uint16_t type;  // 3: 16 bits, 4: 32 bits, 12: double
    std::uint32_t count;
    std::string bytes;
  };
  const auto number = [](std::uint32_t v) { return Tag{4, 1, bytes_of<std::uint32_t>({v})}; };
  std::map<std::uint16_t, Tag> tags = {
      {256, number(t.width)},
      {257, number(t.height)},
      {258, number(16)},
      {259, number(t.compression)},
      {262, number(1)},
      {277, number(1)},
      {339, number(2)},
      {34264, {12, 16, bytes_of(t.transform)}},
      {34735, {3, static_cast<std::uint32_t>(keys.size()), bytes_of(keys)}},
      {34736, {12, 2, bytes_of<double>({1737400, 1737400})}},
  };
  const Tag blocks{4, static_cast<std::uint32_t>(none.size()), bytes_of(none)};
  tags[t.strips ? 273 : 324] = tags[t.strips ? 279 : 325] = blocks;
  if (t.strips) {
    tags[278] = number(t.block_height);
  } else {
    tags[322] = number(t.block_width);
    tags[323] = number(t.block_height);
  }
  std::string entries, values;
  const std::size_t start = 8 + 2 + 12 * tags.size() + 4;
  for (const auto& [id, tag] : tags) {
    entries += bytes_of<std::uint16_t>({id, tag.type}) + bytes_of<std::uint32_t>({tag.count});
    entries += tag.bytes.size() <= 4 ? tag.bytes + std::string(4 - tag.bytes.size(), '\0')
                                     : bytes_of<std::uint32_t>({static_cast<std::uint32_t>(start + values.size())});
    if (tag.bytes.size() > 4) values += tag.bytes;
  }
  return std::string("II*\0\x08\0\0\0", 8) + bytes_of<std::uint16_t>({static_cast<std::uint16_t>(tags.size())}) +
         entries + std::string(4, '\0') + values;
}

struct Vrt {
  int width = 16, height = 16;
  std::string srs = kMoonDegrees, transform = "30,0.0625,0,1,0,-0.0625", content = {}, more = {};
};

std::string vrt(const Vrt& v) {
  return fmt::format(R"(<VRTDataset rasterXSize="{}" rasterYSize="{}"><SRS>{}</SRS><GeoTransform>{}</GeoTransform>)"
                     R"(<VRTRasterBand dataType="Int16" band="1">{}</VRTRasterBand>{}</VRTDataset>)",
                     v.width, v.height, v.srs, v.transform, v.content, v.more);
}

// A source that is opened when it is read, or at once.
std::string source(const std::string& name, bool at_once = false) {
  const char* properties =
      at_once
          ? ""
          : R"(<SourceProperties RasterXSize="16" RasterYSize="16" DataType="Int16" BlockXSize="16" BlockYSize="16"/>)";
  return fmt::format(
      R"(<SimpleSource><SourceFilename relativeToVRT="1">{}</SourceFilename><SourceBand>1</SourceBand>{})"
      R"(<SrcRect xOff="0" yOff="0" xSize="16" ySize="16"/><DstRect xOff="0" yOff="0" xSize="16" )"
      R"(ySize="16"/></SimpleSource>)",
      name, properties);
}

// ---- where the posts lie

TEST_F(RefusedFiles, AGeoTiffOfImpossibleSizeInDegrees) {
  Tiff t;
  EXPECT_EQ(refusal(put("a.tif", tiff(t))), "");
  t.width = 2, t.transform[0] = 1e9;  // 2e9 degrees: no column is left when it is wrapped
  EXPECT_REFUSED(put("a.tif", tiff(t)), "impossible posts");
}

TEST_F(RefusedFiles, ImpossibleTransforms) {
  for (const double wrong : {1e9, 1e300, kInfinity, -kInfinity, kNaN, 1e-9, 1e-300, 4.9e-324, 0.0, -0.0, -1e9, -1e-320})
    for (const int at : {1, 5}) {
      std::vector<double> t = {30, 0.0625, 0, 1, 0, -0.0625};
      t[static_cast<std::size_t>(at)] = wrong;
      EXPECT_NE(refusal(put("t.vrt", vrt({.transform = fmt::format("{}", fmt::join(t, ","))}))), "")
          << at << " " << wrong;
    }
  for (const double wrong : {1e9, -1e300, kInfinity, kNaN})
    for (const int at : {0, 2, 3, 4}) {
      std::vector<double> t = {30, 0.0625, 0, 1, 0, -0.0625};
      t[static_cast<std::size_t>(at)] = wrong;
      EXPECT_NE(refusal(put("t.vrt", vrt({.transform = fmt::format("{}", fmt::join(t, ","))}))), "")
          << at << " " << wrong;
    }
  EXPECT_REFUSED(put("t.vrt", vrt({.transform = "30,0.0001,0,1,0,-0.0625"})), "impossible posts");
}

TEST_F(RefusedFiles, ImpossiblePlanesAtThePole) {
  const auto polar = [&](const std::string& transform, const std::string& scale = "1", const std::string& lon = "0") {
    return refusal(
        put("p.vrt", vrt({.srs = fmt::format(
                              R"(PROJCS["p",{},PROJECTION["Polar_Stereographic"],PARAMETER["latitude_of_origin",-90],)"
                              R"(PARAMETER["central_meridian",{}],PARAMETER["scale_factor",{}],)"
                              R"(PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1]])",
                              kMoonDegrees, lon, scale),
                          .transform = transform})));
  };
  EXPECT_EQ(polar("1000,100,0,1000,0,-100"), "");
  for (const char* transform :
       {"1e12,100,0,1000,0,-100", "1000,100,0,-1e300,0,-100", "nan,100,0,1000,0,-100", "0,1e7,0,0,0,-1e7",
        "0,1e-4,0,0,0,-1e-4", "0,1e300,0,0,0,-1e300", "0,nan,0,0,0,nan", "0,4.9e-324,0,0,0,-4.9e-324"})
    EXPECT_NE(polar(transform), "") << transform;
  for (const char* scale : {"0", "-1", "1e300", "1e-300"})
    EXPECT_NE(polar("1000,100,0,1000,0,-100", scale), "") << scale;
  EXPECT_NE(polar("1000,100,0,1000,0,-100", "1", "1e300"), "");
}

TEST_F(RefusedFiles, MorePostsThanAnyProductHas) {
  EXPECT_REFUSED(put("m.vrt", vrt({.width = 2147483647, .transform = "30,0.000001,0,1,0,-0.000001"})), "along a side");
  EXPECT_REFUSED(put("m.vrt", vrt({.height = 2147483647, .transform = "30,0.000001,0,1,0,-0.000001"})), "along a side");
}

// ---- what one read takes

TEST_F(RefusedFiles, OneHugeTile) {
  const double step = 1.0 / 60000;
  Tiff t{.width = 60000, .height = 60000, .block_width = 60000, .block_height = 60000};
  t.transform[0] = step, t.transform[5] = -step;
  EXPECT_REFUSED(put("h.tif", tiff(t)), "one block of its samples takes 6866 MiB");
  t.strips = true;
  EXPECT_REFUSED(put("h.tif", tiff(t)), "one block of its samples takes 6866 MiB");
  t.block_height = 500;  // 57 MiB, as large as they may be
  EXPECT_EQ(refusal(put("h.tif", tiff(t))), "");
}

TEST_F(RefusedFiles, OneHugeTileInAVrt) {
  Tiff t{.width = 60000, .height = 60000, .block_width = 60000, .block_height = 60000};
  put("h.dat", tiff(t));
  for (const bool at_once : {false, true}) {
    EXPECT_REFUSED(put("v.vrt", vrt({.content = source("h.dat", at_once)})), "h.dat's samples takes 6866 MiB");
    put("inner.xml", vrt({.content = source("h.dat", at_once)}));
    EXPECT_REFUSED(put("v.vrt", vrt({.content = source("inner.xml", at_once)})), "h.dat's samples takes 6866 MiB");
  }
}

TEST_F(RefusedFiles, OneHugeTileOfAMap) {
  Tiff t{.width = 60000, .height = 60000, .block_width = 60000, .block_height = 60000};
  t.transform[0] = 1.0 / 60000, t.transform[5] = -1.0 / 60000;
  ValueMapOptions options;
  options.path = put("h.tif", tiff(t));
  try {
    ValueMap(options, make_value_map_tiles(std::size_t{1} << 20));
    FAIL();
  } catch (const DataError& e) {
    EXPECT_NE(std::string(e.what()).find("one block of its samples"), std::string::npos) << e.what();
  }
}

// ---- what is no file

// Each hangs a reader that opens it, or has no end, or is none.
class NoFiles : public RefusedFiles {
 protected:
  NoFiles() {
    EXPECT_EQ(::mkfifo(file("pipe").c_str(), 0600), 0);
    fs::create_symlink(file("pipe"), file("link"));
    fs::create_directory(file("folder"));
    socket_ = ::socket(AF_UNIX, SOCK_STREAM, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::string path = file("socket");
    std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  ~NoFiles() override { ::close(socket_); }

  const std::vector<std::string> names_ = {"pipe",      "link",       "folder",         "socket",
                                           "/dev/zero", "/dev/stdin", "/proc/self/maps"};
  int socket_ = -1;
};

TEST_F(NoFiles, AsSourcesOfAVrt) {
  for (const std::string& name : names_)
    for (const bool at_once : {false, true}) {
      EXPECT_REFUSED(put("v.vrt", vrt({.content = source(name, at_once)})), name + " is not a regular file");
      put("inner.xml", vrt({.content = source(name, at_once)}));
      EXPECT_REFUSED(put("v.vrt", vrt({.content = source("inner.xml", at_once)})), name + " is not a regular file");
      EXPECT_REFUSED(put("v.vrt", vrt({.more = "<MaskBand><VRTRasterBand dataType=\"Byte\">" + source(name, at_once) +
                                               "</VRTRasterBand></MaskBand>"})),
                     name + " is not a regular file");
    }
  for (const char* name : {"&lt;VRTDataset rasterXSize=&quot;16&quot; rasterYSize=&quot;16&quot;/>", "GTIFF_DIR:1:pipe",
                           "vrt://pipe", "/vsimem/a.tif"})
    EXPECT_REFUSED(put("v.vrt", vrt({.content = source(name)})), "not a file on this machine");
}

TEST_F(NoFiles, AsTheDataOfALabel) {
  const std::string label = test::write_kaguya_tile(folder_.path(), 12, 5, 1, 16, [](double, double) { return 7.0; });
  const std::string image = fs::path(label).replace_extension(".img").string();
  fs::remove(image);
  ASSERT_EQ(::mkfifo(image.c_str(), 0600), 0);
  EXPECT_THROW(inspect_raster(label), DataError);
  EXPECT_THROW(inspect_raster(image), DataError);
  EXPECT_EQ(Catalogue({folder_.path()}).problems().size(), 1U);
  fs::remove(label);
  ASSERT_EQ(::mkfifo(label.c_str(), 0600), 0);
  EXPECT_THROW(inspect_raster(label), DataError);
  EXPECT_EQ(Catalogue({folder_.path()}).rasters().size(), 1U);
}

TEST_F(NoFiles, ReplacingInspectedFiles) {
  const std::string path = put("v.vrt", vrt({.content = source("s.dat")}));
  put("s.dat", tiff({}));
  const RasterInfo info = inspect_raster(path);
  fs::remove(file("s.dat"));
  ASSERT_EQ(::mkfifo(file("s.dat").c_str(), 0600), 0);
  EXPECT_THROW(Raster{info}, DataError);
  fs::remove(path);
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  EXPECT_THROW(Raster{info}, DataError);
}

// ---- what a VRT asks for

TEST_F(RefusedFiles, AMissingSourceIsNamedAtTheStartAndByEachRead) {
  put("s.dat", tiff({}));
  put("v.vrt", vrt({.content = source("s.dat")}));
  EXPECT_TRUE(Catalogue(std::vector<std::string>{file("v.vrt")}).problems().empty());
  put("v.vrt", vrt({.content = source("s.dat") + source("gone.dat")}));
  const Catalogue catalogue(std::vector<std::string>{file("v.vrt")});
  ASSERT_EQ(catalogue.rasters().size(), 1U);
  ASSERT_EQ(catalogue.problems().size(), 1U);
  EXPECT_TRUE(catalogue.problems()[0].located);
  EXPECT_NE(catalogue.problems()[0].what.find("gone.dat is missing"), std::string::npos);
  Raster raster(catalogue.rasters()[0]);
  std::vector<float> heights(16 * 16);
  for (int i = 0; i < 2; ++i) try {
      raster.read(0, 0, 16, 16, heights.data());
      FAIL() << "a VRT without its source gave posts";
    } catch (const DataError& error) {
      EXPECT_NE(std::string(error.what()).find("gone.dat"), std::string::npos) << error.what();
    }
}

TEST_F(RefusedFiles, VrtsOfTooManySources) {
  put("s.dat", tiff({}));
  std::string many;
  for (int i = 0; i < 10000; ++i) many += source("s.dat");
  EXPECT_EQ(refusal(put("v.vrt", vrt({.content = many}))), "");
  EXPECT_REFUSED(put("v.vrt", vrt({.content = many + source("s.dat")})), "more than 10000 sources");
  // The same by few: each names the next one ten times.
  put("inner0.xml", vrt({.content = source("s.dat")}));
  for (int i = 0; i < 6; ++i) {
    std::string ten;
    for (int k = 0; k < 10; ++k) ten += source("inner" + std::to_string(i) + ".xml");
    put("inner" + std::to_string(i + 1) + ".xml", vrt({.content = ten}));
  }
  EXPECT_REFUSED(put("v.vrt", vrt({.content = source("inner6.xml")})), "more than 10000 sources");
}

TEST_F(RefusedFiles, VrtsThatNameThemselves) {
  for (const bool at_once : {false, true}) {
    EXPECT_REFUSED(put("v.vrt", vrt({.content = source("v.vrt", at_once)})), "name each other");
    put("a.xml", vrt({.content = source("b.xml", at_once)}));
    put("b.xml", vrt({.content = source("a.xml", at_once)}));
    EXPECT_REFUSED(put("v.vrt", vrt({.content = source("a.xml", at_once)})), "name each other");
  }
}

TEST_F(RefusedFiles, VrtsThatAreTooLargeOrTooDeep) {
  const std::string path = put("v.vrt", vrt({}));
  fs::resize_file(path, std::uintmax_t{1} << 40);
  EXPECT_REFUSED(path, "is too large");
  std::string deep;
  for (int i = 0; i < 1000000; ++i) deep += "<a>";
  EXPECT_NE(refusal(put("v.vrt", vrt({.more = deep}))), "");
}

TEST_F(RefusedFiles, VrtsThatCompute) {
  put("s.dat", tiff({}));
  for (const char* element :
       {"<PixelFunctionType>sum</PixelFunctionType>",
        "<PixelFunctionLanguage>Python</PixelFunctionLanguage><PixelFunctionType>f.f</PixelFunctionType>",
        "<PixelFunctionCode>def f(): pass</PixelFunctionCode>"})
    EXPECT_REFUSED(put("v.vrt", vrt({.content = element + source("s.dat")})), "is not supported");
  EXPECT_REFUSED(
      put("v.vrt", vrt({.more = "<GDALWarpOptions><WarpMemoryLimit>1e12</WarpMemoryLimit></GDALWarpOptions>"})),
      "WarpMemoryLimit");
}

// ---- names on a network

class RemoteNames : public ::testing::Test {
 protected:
  ~RemoteNames() override { allow_remote_files({}); }
};

TEST_F(RemoteNames, APrefixIsANameOrAFolder) {
  allow_remote_files({"/vsicurl/http://host:2115", "/vsicurl/https://example.org/dem/", "/vsis3/bucket/a.tif", ""});
  for (const char* name : {"/vsicurl/http://host:2115", "/vsicurl/http://host:2115/a.tif",
                           "/vsicurl/https://example.org/dem/b/c.tif", "/vsis3/bucket/a.tif"})
    EXPECT_TRUE(is_allowed(name)) << name;
  for (const char* name :
       {"/vsicurl/http://host:21151/a.tif", "/vsicurl/http://host:2115@elsewhere/a.tif",
        "/vsicurl/http://host:2115.elsewhere/a.tif", "/vsicurl/https://example.org/dem", "/vsis3/bucket/a.tif.aux.xml",
        "/vsicurl/https://example.org/dem/../a.tif", "/vsis3/another/a.tif", ""})
    EXPECT_FALSE(is_allowed(name)) << name;
}

}  // namespace
}  // namespace selenograph::dem
