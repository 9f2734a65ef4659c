// All of the Moon in tiles of one degree: how long its catalogue takes to open, and what a frame costs over it.
#include "dem/catalogue/catalogue.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <vector>

#include "dem/gdal/geotiff_writer.h"
#include "engine/renderer.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"
#include "tests/support/views.h"

namespace selenograph {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr int kPostsPerDegree = 8, kSites = 100;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

double height_m(double lat_deg, double lon_deg) { return std::round(100 * std::sin(lat_deg) * std::cos(3 * lon_deg)); }

class WholeMoon : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder;
    for (int top = 90; top > -90; --top)
      for (int west = 0; west < 360; ++west)
        test::write_kaguya_tile(path("tiles"), top, west, 1, kPostsPerDegree, height_m);
    fs::create_directories(path("sites"));
    const std::vector<float> heights(32 * 32, 50.F);
    for (int i = 0; i < kSites; ++i)
      dem::write_geotiff(path(fmt::format("sites/site_{}.tif", i)), {-60 + i * 0.5, 100, 1e-3, 1e-3, 32, 32}, heights,
                         "height");
  }
  static void TearDownTestSuite() { delete folder_; }

  static std::string path(const std::string& name) { return folder_->path() + "/" + name; }
  static dem::Catalogue opened() {
    const Clock::time_point start = Clock::now();
    dem::Catalogue catalogue(std::vector<std::string>{path("tiles"), path("sites")});
    fmt::print("{:.2f} s, {} files\n", seconds_since(start), catalogue.rasters().size());
    return catalogue;
  }

  static inline test::TemporaryFolder* folder_ = nullptr;
};

// The same sixteen tiles are seen, with a ring of neighbours around them or among all of the Moon.
TEST_F(WholeMoon, AFrameCostsAsMuchAsWithSixteenTiles) {
  const auto terrain_of = [](std::vector<dem::RasterInfo> rasters) {
    return std::make_shared<dem::PyramidTerrain>(dem::Catalogue(std::move(rasters)),
                                                 dem::TerrainOptions{{}, std::size_t{512} << 20, false});
  };
  const auto lies_within = [](const dem::Footprint& f, double around_deg) {
    return f.south_deg > 9.99 - around_deg && f.north_deg < 14.01 + around_deg && f.west_deg > 19.99 - around_deg &&
           f.east_deg < 24.01 + around_deg;
  };
  std::vector<dem::RasterInfo> near, everywhere;
  const dem::Catalogue moon = opened();
  for (dem::RasterInfo r : moon.rasters()) {
    // Nothing is built but what is seen: tiles beyond the neighbours are as fine as real ones, whose pyramids are not
    // looked into unless they are in view, and those between are left out.
    if (lies_within(r.footprint, 1))
      near.push_back(r);
    else if (!lies_within(r.footprint, 8))
      r.lattice_level = 12;
    else
      continue;
    everywhere.push_back(r);
  }
  ASSERT_EQ(near.size(), 36U);
  ASSERT_GT(everywhere.size(), 64400U);
  const auto few = terrain_of(near), all = terrain_of(everywhere);
  const engine::Renderer renderers[] = {{few, {1, std::size_t{256} << 20}}, {all, {1, std::size_t{256} << 20}}};
  engine::FrameRequest request;
  request.camera = test::square_camera(64, 40);
  const Vec3 from = to_cartesian({12, 22, 100000});
  request.pose = test::looking(from, -from, local_axes(from).north);
  request.sun.direction = from.normalized();
  request.products = engine::kSource | engine::kRadiance;
  constexpr int kFrames = 300;
  std::vector<double> times_s[2];
  for (int i = 0; i < kFrames; ++i)
    for (int k = 0; k < 2; ++k) {
      const Clock::time_point start = Clock::now();
      const engine::Frame frame = renderers[k].render(request);
      ASSERT_NE((k ? all : few)->catalogue().fingerprint(), 0U);  // part of every answer
      times_s[k].push_back(seconds_since(start));
      ASSERT_GE(frame.report.sources.size(), 9U);
      ASSERT_LE(frame.report.sources.size(), 16U);
    }
  for (std::vector<double>& times : times_s) std::nth_element(times.begin(), times.begin() + kFrames / 2, times.end());
  const double sixteen_s = times_s[0][kFrames / 2], all_s = times_s[1][kFrames / 2];
  fmt::print("median frame: {:.3f} ms over 16 tiles, {:.3f} ms over the Moon\n", 1e3 * sixteen_s, 1e3 * all_s);
  EXPECT_LT(all_s / sixteen_s, 1.5);
}

}  // namespace
}  // namespace selenograph
