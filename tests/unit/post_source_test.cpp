// LayerFiles composed to posts: copied bit for bit where they lie on the lattice, exact for slopes where they don't,
// voids and seams.
#include "dem/posts/post_source.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <optional>
#include <random>

#include "dem/base/error.h"
#include "dem/gdal/raster.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

using test::FloatTile;
using test::TemporaryFolder;
using test::write_float_tile;
using test::write_kaguya_tile;

std::int64_t lat_tick(double deg) { return std::llround((deg + 90) * kTicksPerDegree); }
std::int64_t lon_tick(double deg) { return std::llround((deg + 180) * kTicksPerDegree); }

PostWindow posts_window(int level, double south, double west, int rows, int cols) {
  const Tick step = 1 << (kTickLevel - level);
  return {lat_tick(south), lon_tick(west), step, step, rows, cols};
}

struct LayerFiles {
  explicit LayerFiles(const std::string& folder, bool fall_through = false)
      : catalogue(std::vector<std::string>{folder}),
        source(catalogue, fall_through,
               [this](const std::string&, const std::string& text) { warnings.push_back(text); }) {}
  std::string name(SourceMark s) const { return catalogue.rasters()[source_of(s)].name; }
  Catalogue catalogue;
  std::vector<std::string> warnings;
  PostSource source;
};

// A slope that is exact in float at every post of a 2^n lattice.
double slope(double lat, double lon) { return 100 * lat - 50 * lon; }

TEST(PostSource, UncoveredPostsAreNoData) {
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 12, 20, 2, 16, slope);
  LayerFiles layers(folder.path());
  const Posts posts = layers.source.compose(posts_window(4, 9, 19, 5 * 16, 4 * 16));
  for (int r = 0; r < 80; ++r)
    for (int c = 0; c < 64; ++c) {
      const double lat = 9 + r / 16.0, lon = 19 + c / 16.0;
      const bool inside = lat > 10 && lat <= 12 && lon >= 20 && lon < 22;
      const auto at = static_cast<std::size_t>(r) * 64 + static_cast<std::size_t>(c);
      ASSERT_EQ(std::isnan(posts.heights[at]), !inside) << lat << ' ' << lon;
      ASSERT_EQ(posts.sources[at], inside ? 0 : kNoSource);
    }
}

TEST(PostSource, FinestValidLayerWins) {
  TemporaryFolder folder;
  write_float_tile(folder.path(), "coarse", {14, 18, 8, 6 * 8 + 1, 6 * 8 + 1}, [](double, double) { return 1.0; });
  const auto hole = [](double lat, double lon) { return std::abs(lat - 11) < 0.2 && std::abs(lon - 21) < 0.2; };
  write_float_tile(
      folder.path(), "fine", {12, 20, 16, 33, 33}, [](double, double) { return 2.0; }, hole);
  LayerFiles layers(folder.path());
  layers.catalogue.join_layers({0, {}});
  const Posts posts = layers.source.compose(posts_window(4, 9, 19, 65, 65));
  for (int r = 0; r < 65; ++r)
    for (int c = 0; c < 65; ++c) {
      const double lat = 9 + r / 16.0, lon = 19 + c / 16.0;
      const bool fine = lat >= 10 && lat <= 12 && lon >= 20 && lon <= 22 && !hole(lat, lon);
      const auto at = static_cast<std::size_t>(r) * 65 + static_cast<std::size_t>(c);
      ASSERT_EQ(posts.heights[at], fine ? 2.F : 1.F) << lat << ' ' << lon;
      ASSERT_EQ(layers.name(posts.sources[at]), fine ? "fine" : "coarse");
    }
}

// Of posts off the lattice: the kernel spread such marks over their neighbours.
TEST(PostSource, UndeclaredVoidsAreVoidsBeforeTheyAreInterpolated) {
  const auto hole = [](double lat, double lon) { return std::hypot(lat - 11, lon - 21) < 0.25; };
  const auto composed = [&](std::optional<double> mark) {
    TemporaryFolder folder;
    const auto height_m = [&](double lat, double lon) { return mark && hole(lat, lon) ? *mark : slope(lat, lon); };
    write_float_tile(folder.path(), "t", {12, 20, 10, 21, 21}, height_m,
                     [&](double lat, double lon) { return !mark && hole(lat, lon); });
    LayerFiles layers(folder.path());
    std::vector<float> heights = layers.source.compose(posts_window(4, 10, 20, 33, 33)).heights;
    EXPECT_EQ(layers.warnings.empty(), !mark);
    std::ranges::replace_if(
        heights, [](float h) { return std::isnan(h); }, -1e6F);
    return heights;
  };
  const std::vector<float> declared = composed(std::nullopt);
  EXPECT_GT(std::ranges::count(declared, -1e6F), 10);
  for (const double mark : {-32768.0, -32767.0, 32767.0, 65535.0, -9999.0}) EXPECT_EQ(composed(mark), declared) << mark;
}

TEST(PostSource, VoidsInASlopeAreFilledExactlyAndFlagged) {
  TemporaryFolder folder;
  const auto hole = [](double lat, double lon) { return std::abs(lat - 11) < 0.4 && std::abs(lon - 21) < 0.3; };
  write_float_tile(folder.path(), "t", {12, 20, 16, 33, 33}, slope, hole);
  LayerFiles layers(folder.path());
  const PostWindow w = posts_window(4, 10, 20, 33, 33);
  Posts posts = layers.source.compose(w);
  PostSource::fill_voids(w, posts);
  int filled = 0;
  for (int r = 0; r < 33; ++r)
    for (int c = 0; c < 33; ++c) {
      const double lat = 10 + r / 16.0, lon = 20 + c / 16.0;
      const auto at = static_cast<std::size_t>(r) * 33 + static_cast<std::size_t>(c);
      ASSERT_NEAR(posts.heights[at], slope(lat, lon), 1e-3);
      ASSERT_EQ(is_filled(posts.sources[at]), hole(lat, lon));
      ASSERT_EQ(source_of(posts.sources[at]), 0);
      filled += hole(lat, lon);
    }
  EXPECT_GT(filled, 50);
}

TEST(PostSource, NoFillingBeyondTheReachOrOutside) {
  PostWindow w = posts_window(4, 0, 0, 3, 200);
  Posts posts{std::vector<float>(w.size(), std::nanf("")), std::vector<SourceMark>(w.size(), kNoSource)};
  const auto put = [&](int c) {
    for (int r = 0; r < 3; ++r)
      posts.heights[static_cast<std::size_t>(r * 200 + c)] = 5,
                                                       posts.sources[static_cast<std::size_t>(r * 200 + c)] = 0;
  };
  put(10), put(10 + 2 * kFillReach), put(150);
  PostSource::fill_voids(w, posts);
  // Exactly one post between the first two is within reach of both.
  for (int c = 0; c < 200; ++c) {
    const bool valid = c == 10 || c == 10 + kFillReach || c == 10 + 2 * kFillReach || c == 150;
    EXPECT_EQ(!std::isnan(posts.heights[static_cast<std::size_t>(200 + c)]), valid) << c;
  }
}

TEST(PostSource, OtherLatticesAreExactForSlopes) {
  TemporaryFolder folder;
  // 20 px/deg is no power of two: every post is interpolated.
  write_float_tile(folder.path(), "t", {12, 20, 20, 41, 41}, slope);
  LayerFiles layers(folder.path());
  ASSERT_FALSE(layers.catalogue.rasters()[0].lattice_level);
  EXPECT_EQ(level_needed(layers.catalogue.rasters()[0]), 5);
  const Posts posts = layers.source.compose(posts_window(5, 10, 20, 65, 65));
  for (int r = 0; r < 65; ++r)
    for (int c = 0; c < 65; ++c)
      ASSERT_NEAR(posts.heights[static_cast<std::size_t>(r * 65 + c)], slope(10 + r / 32.0, 20 + c / 32.0), 2e-3)
          << r << ' ' << c;
}

TEST(PostSource, SeamsOfAnotherLatticeAreClosedAndNotFilled) {
  TemporaryFolder folder;
  for (const int top : {11, 12})
    for (const int west : {20, 21})
      write_kaguya_tile(folder.path(), top, west, 1, 20,
                        [](double lat, double lon) { return std::round(slope(lat, lon) * 20) / 20; });
  LayerFiles layers(folder.path());
  const PostWindow w = posts_window(5, 10.25, 20, 49, 56);
  Posts posts = layers.source.compose(w);
  for (int r = 0; r < w.rows; ++r)
    for (int c = 0; c < w.cols; ++c) {
      const auto at = static_cast<std::size_t>(r * w.cols + c);
      const double lat = 10.25 + r / 32.0, lon = 20 + c / 32.0;
      ASSERT_FALSE(std::isnan(posts.heights[at])) << lat << ' ' << lon;
      ASSERT_NEAR(posts.heights[at], slope(lat, lon), 1) << lat << ' ' << lon;  // whole metres
    }
}

TEST(PostSource, PolesAreOnePointAndRowsGoOnBeyond) {
  TemporaryFolder folder;
  const auto height = [](double lat, double lon) {
    return std::abs(lat) > 89.99 ? 7.0 : std::round(100 * std::cos(lon * M_PI / 180) + 10 * (90 - std::abs(lat)));
  };
  test::write_global_tile(folder.path(), 4, height);
  LayerFiles layers(folder.path());
  for (const double pole : {-90.0, 90.0}) {
    PostWindow w = posts_window(2, pole - 1, 30, 9, 40);
    const Posts posts = layers.source.compose(w);
    for (int r = 0; r < 9; ++r)
      for (int c = 0; c < 40; ++c) {
        double lat = pole - 1 + r / 4.0, lon = 30 + c / 4.0;
        if (std::abs(lat) > 90) lat = (pole > 0 ? 180 : -180) - lat, lon += 180;
        ASSERT_NEAR(posts.heights[static_cast<std::size_t>(r * 40 + c)], height(lat, lon), 1e-4) << lat << ' ' << lon;
      }
  }
}

TEST(PostSource, APoleBetweenPostsIsOnePointToo) {
  // Pixels that are areas: the outermost posts lie half a post from the poles.
  TemporaryFolder folder;
  const auto height = [](double lat, double lon) {
    return 500 * std::cos(lat * M_PI / 180) * std::cos(lon * M_PI / 180) + 3;
  };
  write_float_tile(folder.path(), "area", {90 - 0.125, 0.125, 4, 720, 1440}, height);
  LayerFiles layers(folder.path());
  for (const double pole : {-90.0, 90.0}) {
    const PostWindow w = posts_window(2, pole - 1, -180, 9, 1441);
    const Posts posts = layers.source.compose(w);
    for (int c = 0; c < w.cols; ++c) {
      ASSERT_EQ(posts.heights[static_cast<std::size_t>(4 * w.cols + c)],
                posts.heights[static_cast<std::size_t>(4 * w.cols)])
          << c;
    }
    EXPECT_NEAR(posts.heights[static_cast<std::size_t>(4 * w.cols)], 3, 0.1);
  }
}

// Tiles of one product end a post before the south pole; voids beside it make it no less of a point.
TEST(PostSource, APoleThatNoFileHoldsIsOnePointBesideVoidsToo) {
  TemporaryFolder folder;
  for (int west = 0; west < 360; west += 90)
    test::write_kaguya_tile(
        folder.path(), -89, west, 1, 16, [](double, double lon) { return std::abs(lon) < 100 ? 10 : 30; },
        [](double, double lon) { return lon == 22.5 || lon == -180; });
  LayerFiles layers(folder.path());
  for (const double west : {-180.0, 20.0}) {
    const Posts posts = layers.source.compose(posts_window(4, -90, west, 1, 64));
    for (std::size_t c = 0; c < 64; ++c) {
      ASSERT_EQ(posts.heights[c], posts.heights[0]);
      ASSERT_TRUE(is_filled(posts.sources[c]));
    }
    EXPECT_GT(posts.heights[0], 10);
    EXPECT_LT(posts.heights[0], 30);
  }
}

TEST(PostSource, ImpossibleHeightsAreVoidsWithAWarning) {
  TemporaryFolder folder;
  write_float_tile(folder.path(), "t", {12, 20, 16, 17, 17},
                   [](double lat, double lon) { return lat == 11.5 && lon == 20.5 ? 32767.0 : 5.0; });
  LayerFiles layers(folder.path());
  const Posts posts = layers.source.compose(posts_window(4, 11, 20, 17, 17));
  for (int i = 0; i < 17 * 17; ++i) EXPECT_EQ(std::isnan(posts.heights[static_cast<std::size_t>(i)]), i == 8 * 17 + 8);
  ASSERT_EQ(layers.warnings.size(), 1U);
  EXPECT_NE(layers.warnings[0].find("t.lbl"), std::string::npos) << layers.warnings[0];
}

TEST(PostSource, UnreadableFilesAreErrorsOrFallThrough) {
  TemporaryFolder folder;
  write_float_tile(folder.path(), "below", {14, 18, 8, 49, 49}, [](double, double) { return 1.0; });
  write_float_tile(folder.path(), "above", {12, 20, 16, 33, 33}, [](double, double) { return 2.0; });
  LayerFiles strict(folder.path()), lenient(folder.path(), true);
  for (const bool vanish : {false, true}) {
    if (vanish)
      std::filesystem::remove(folder / "above.img");
    else
      std::filesystem::resize_file(folder / "above.img", 1000);
    try {
      strict.source.compose(posts_window(4, 10, 20, 33, 33));
      ADD_FAILURE() << "a damaged file went unnoticed";
    } catch (const DataError& error) {
      EXPECT_NE(std::string(error.what()).find("above"), std::string::npos) << error.what();
    }
    const Posts posts = lenient.source.compose(posts_window(4, 10, 20, 33, 33));
    for (const float h : posts.heights) EXPECT_EQ(h, 1.F);
    ASSERT_EQ(posts.replaced.size(), 1U);
    EXPECT_EQ(lenient.name(posts.replaced[0]), "above");
    ASSERT_FALSE(lenient.warnings.empty());
    EXPECT_NE(lenient.warnings.back().find("above"), std::string::npos) << lenient.warnings.back();
  }
}

TEST(PostSource, TilesOfTheWholeArchiveKeepTheirNumbers) {
  // 64 800 tiles of one degree: the one that is really there has a number past 2^15.
  TemporaryFolder folder;
  const RasterInfo real =
      inspect_raster(write_float_tile(folder.path(), "zz", {12, 20, 16, 17, 17}, [](double, double) { return 4.0; }));
  std::vector<RasterInfo> archive;
  for (int i = 0; i < 64799; ++i) {
    RasterInfo info = real;
    info.name = "aa" + std::to_string(i);
    info.path = "/nowhere/" + info.name;
    info.footprint = {-50, -49, 100, 101};
    archive.push_back(info);
  }
  archive.push_back(real);
  const Catalogue catalogue(archive);
  PostSource source(catalogue, false, [](const std::string&, const std::string&) {});
  const Posts posts = source.compose(posts_window(4, 11, 20, 17, 17));
  for (std::size_t i = 0; i < posts.heights.size(); ++i) {
    ASSERT_EQ(posts.heights[i], 4.F);
    ASSERT_EQ(posts.sources[i] & kFilledBit, 0U) << "flagged as filled";
    ASSERT_EQ(catalogue.rasters()[posts.sources[i]].name, "zz");
  }
}

}  // namespace
}  // namespace selenograph::dem
