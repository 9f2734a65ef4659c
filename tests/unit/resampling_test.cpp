// Places of posts and what resampling does to them.
#include "dem/terrain/resampling.h"

#include <gtest/gtest.h>

#include <cmath>

#include "dem/gdal/raster.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

TEST(Resampling, PlaceOfPostIsTheInverseOfLocate) {
  const test::TemporaryFolder folder;
  const RasterInfo info = inspect_raster(
      test::write_float_tile(folder.path(), "tile", {27, 178, 10, 31, 41}, [](double, double) { return 0.0; }));
  for (const int y : {0, 7, 30})
    for (const int x : {0, 13, 40}) {
      const Geographic g = place_of_post(info, x, y);
      const PostXY back = locate(info, g.lat_deg, g.lon_deg);
      EXPECT_NEAR(back.x, x, 1e-9);
      EXPECT_NEAR(back.y, y, 1e-9);
    }
}

// 10 px/deg onto 16: a slope survives, a wave near the posts' limit doesn't, and nothing is hidden.
TEST(Resampling, IsExactForASlopeAndReportedForAWave) {
  const auto error_of = [](const test::HeightFunction& height_m) {
    const test::TemporaryFolder folder;
    test::write_float_tile(folder.path(), "tile", {12, 20, 10, 41, 41}, height_m);
    return resampling_error(*test::open_terrain(folder.path()), 0, 500);
  };
  const ResamplingError slope = error_of([](double lat, double lon) { return 100 * lat + 30 * lon; });
  EXPECT_GT(slope.posts, 400);
  EXPECT_LT(slope.worst_m, 0.02);  // float32 posts, and chords 2 mm below the sphere
  const ResamplingError wave =
      error_of([](double lat, double lon) { return 50 * std::sin(lat * 12) * std::sin(lon * 11); });
  EXPECT_GT(wave.rms_m, 0.5);
  EXPECT_GE(wave.worst_m, wave.rms_m);
  EXPECT_LT(wave.worst_m, 50);
}

}  // namespace
}  // namespace selenograph::dem
