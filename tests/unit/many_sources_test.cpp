// More files than 16 bits can tell apart: heights, frames and the pyramid name the right one.
#include <gtest/gtest.h>

#include <cmath>

#include "dem/base/error.h"
#include "dem/terrain/pyramid_terrain.h"
#include "engine/renderer.h"
#include "engine/visibility/image/frame_sources.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph {
namespace {

using test::TemporaryFolder;
using test::write_kaguya_tile;

constexpr std::size_t kOthers = 70000;

// Two real tiles side by side and, on the other side of the Moon, 70 000 that nobody reads.
dem::Catalogue large_catalogue(const std::string& folder) {
  const auto height = [](double, double lon_deg) { return lon_deg < 21 ? 100.0 : 200.0; };
  write_kaguya_tile(folder, 11, 20, 1, 64, height);
  write_kaguya_tile(folder, 11, 21, 1, 64, height);
  std::vector<dem::RasterInfo> rasters = dem::Catalogue(std::vector<std::string>{folder}).rasters();
  dem::RasterInfo other = rasters[0];
  other.post_spacing_m *= 2;  // coarser, hence before the real ones
  other.lattice_level = 12;   // so fine that selection doesn't look into their pyramid unless they are in view
  other.footprint = {-31, -30.1, -161, -160.1};
  for (std::size_t i = 0; i < kOthers; ++i) {
    other.path = other.name = "other-" + std::to_string(i);
    rasters.push_back(other);
  }
  return dem::Catalogue(std::move(rasters));
}

TEST(TerrainOfManySources, HeightsNameTheirSource) {
  TemporaryFolder folder, cache;
  for (const char* pyramid : {"built", "read"}) {
    const dem::PyramidTerrain terrain(large_catalogue(folder.path()), {cache.path(), std::size_t{256} << 20, false});
    ASSERT_EQ(terrain.catalogue().rasters().size(), kOthers + 2);
    for (const double lon_deg : {20.5, 21.5}) {
      const dem::HeightAnswer answer = terrain.height(10.5, lon_deg);
      EXPECT_NEAR(answer.height_m, lon_deg < 21 ? 100 : 200, 1e-6) << pyramid;
      ASSERT_GE(answer.source, 65536);
      EXPECT_EQ(terrain.catalogue().rasters()[static_cast<std::size_t>(answer.source)].name,
                lon_deg < 21 ? "DTM_MAP_01_N11E020N10E021SC" : "DTM_MAP_01_N11E021N10E022SC");
    }
  }
}

TEST(TerrainOfManySources, FramesListWhatTheySee) {
  TemporaryFolder folder;
  const auto terrain = std::make_shared<dem::PyramidTerrain>(large_catalogue(folder.path()),
                                                             dem::TerrainOptions{{}, std::size_t{256} << 20, false});
  const engine::Renderer renderer(terrain, {2, std::size_t{256} << 20});
  for (const auto visibility : {engine::Visibility::zbuffer, engine::Visibility::raytrace}) {
    engine::FrameRequest request;
    request.camera = test::square_camera(64, 40);
    const Vec3 from = to_cartesian({10.5, 21, 20000});
    request.pose = test::looking(from, -from, local_axes(from).north);
    request.sun.direction = test::local_sun(10.5, 21, 90, 40);
    request.products = engine::kSource | engine::kGeodetic;
    request.visibility = visibility;
    const engine::Frame frame = renderer.render(request);
    ASSERT_EQ(frame.report.sources.size(), 2U);
    ASSERT_EQ(frame.report.sources[0].name, "DTM_MAP_01_N11E020N10E021SC");
    ASSERT_EQ(frame.report.sources[1].name, "DTM_MAP_01_N11E021N10E022SC");
    for (std::size_t i = 0; i < frame.products.source.size(); ++i) {
      const double lon_deg = frame.products.geodetic[3 * i + 1];
      if (std::abs(lon_deg - 21) > 0.02) {
        ASSERT_EQ(frame.products.source[i], lon_deg < 21 ? 0 : 1) << lon_deg;
      }
    }
  }
}

TEST(FrameSources, NumbersFollowTheCatalogueWhateverTheOrder) {
  engine::FrameSources sources(100000);
  std::vector<std::uint16_t> product = {sources.product_number(99999), sources.product_number(7),
                                        engine::FrameSources::kNone, sources.product_number(70000),
                                        sources.product_number(7)};
  EXPECT_EQ(sources.resolve(product), (std::vector<dem::SourceIndex>{7, 70000, 99999}));
  EXPECT_EQ(product, (std::vector<std::uint16_t>{2, 0, engine::FrameSources::kNone, 1, 0}));
}

TEST(FrameSources, TooManySourcesThrow) {
  engine::FrameSources sources(65536);
  for (dem::SourceIndex i = 0; i < 65535; ++i) ASSERT_EQ(sources.product_number(i), i);
  EXPECT_THROW(sources.product_number(65535), TooMuchTerrain);
  std::vector<std::uint16_t> product;
  EXPECT_EQ(sources.resolve(product).size(), 65536U);
}

}  // namespace
}  // namespace selenograph
