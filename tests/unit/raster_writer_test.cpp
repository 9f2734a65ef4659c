#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <vector>

#include "dem/base/error.h"
#include "dem/gdal/geotiff_writer.h"
#include "dem/gdal/raster.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

constexpr GeotiffGrid kGrid{-7.25, 39.5, 1.0 / 1024, 1.0 / 1024, 5, 3};

std::vector<float> values() {
  std::vector<float> v;
  for (int i = 0; i < 15; ++i) v.push_back(static_cast<float>(0.125 * i - 3));
  v[7] = NAN;
  return v;
}

TEST(RasterWriter, RoundTripsPosts) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "difference.tif";
  write_geotiff(path, kGrid, values(), "difference");
  const RasterInfo info = inspect_raster(path);
  EXPECT_EQ(info.projection(), Projection::geographic);
  EXPECT_DOUBLE_EQ(info.posts_per_degree, 1024);
  EXPECT_EQ(info.lattice_level, 10) << "post = pixel centre";
  Raster raster(info);
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 5; ++c) {
      const auto at = locate(raster.info(), -7.25 - r / 1024.0, 39.5 + c / 1024.0);
      EXPECT_NEAR(at.x, c, 1e-9);
      EXPECT_NEAR(at.y, r, 1e-9);
      float read = 0;
      raster.read(c, r, 1, 1, &read);
      const float written = values()[static_cast<std::size_t>(5 * r + c)];
      EXPECT_TRUE(read == written || (std::isnan(read) && std::isnan(written))) << r << " " << c;
    }
}

TEST(RasterWriter, SameBytesInMemory) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "a.tif";
  write_geotiff(path, kGrid, values(), "difference");
  std::ifstream file(path, std::ios::binary);
  const std::string written{std::istreambuf_iterator<char>(file), {}};
  EXPECT_EQ(geotiff_bytes(kGrid, values(), "difference"), written);
  EXPECT_EQ(written.substr(0, 4), std::string("II*\0", 4));
}

TEST(RasterWriter, FailedWriteLeavesNoFile) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directory(folder / "taken.tif");
  EXPECT_THROW(write_geotiff(folder / "taken.tif", kGrid, values(), ""), SystemFault);
  EXPECT_THROW(write_geotiff(folder / "b.tif", {0, 0, 1, 1, 4, 4}, values(), ""), std::invalid_argument);
  int entries = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder.path())) ++entries;
  EXPECT_EQ(entries, 1);
}

}  // namespace
}  // namespace selenograph::dem
