// Layers that meet: the finer one unchanged, the coarser one bent, the same from any window; offsets given and fitted;
// steps along borders.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "dem/base/error.h"
#include "dem/posts/layer_joins.h"
#include "dem/posts/post_source.h"
#include "dem/posts/resolved_posts.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

using test::FloatTile;
using test::TemporaryFolder;
using test::write_float_tile;

PostWindow window(int level, double south, double west, int rows, int cols) {
  const Tick step = 1 << (kTickLevel - level);
  return {std::llround((south + 90) * kTicksPerDegree),
          std::llround((west + 180) * kTicksPerDegree),
          step,
          step,
          rows,
          cols};
}

struct Layers {
  explicit Layers(const std::string& folder, double blend_posts = 16, const std::vector<NamedNumber>& offsets = {})
      : catalogue(std::vector<std::string>{folder}),
        fits(join_layers(catalogue, blend_posts, offsets)),
        source(catalogue, false, [](const std::string&, const std::string&) {}) {}
  std::string name(SourceMark s) const { return catalogue.rasters()[source_of(s)].name; }
  Catalogue catalogue;
  std::vector<FittedOffset> fits;
  PostSource source;
};

double flat(double, double) { return 0; }
double high(double, double) { return 100; }

// 4 posts of the fine layer to one of the coarse layer: a band of 16 is 64 fine posts.
constexpr double kCoarse = 16, kFine = 64;
void write_coarse(const TemporaryFolder& folder, const test::HeightFunction& height_m = flat) {
  write_float_tile(folder.path(), "coarse", {20, 10, kCoarse, 20 * 16 + 1, 20 * 16 + 1}, height_m);
}
// 12 .. 16 N, 18 .. 22 E.
void write_fine(const TemporaryFolder& folder, const test::HeightFunction& height_m = high,
                const test::VoidFunction& is_void = {}) {
  write_float_tile(folder.path(), "fine", {16, 18, kFine, 4 * 64 + 1, 4 * 64 + 1}, height_m, is_void);
}

TEST(Layers, FinerPostsAreUnchangedAndTheCoarserLayerBends) {
  TemporaryFolder folder;
  write_coarse(folder), write_fine(folder);
  const Layers layers(folder.path());
  ASSERT_EQ(layers.source.bends().band_posts(1), 64);
  // Along a parallel through the middle, from two bands outside to the middle.
  const Posts posts = layers.source.compose(window(6, 14, 16, 1, 4 * 64 + 1));
  double steepest = 0, curved = 0;
  for (std::size_t c = 0; c < posts.heights.size(); ++c) {
    const double inside = static_cast<double>(c) - 128;  // posts from the border
    const float h = posts.heights[c];
    if (inside >= 0) {
      ASSERT_EQ(h, 100) << c;
      ASSERT_EQ(posts.sources[c], 1U) << c;
    } else if (inside < -66) {
      ASSERT_EQ(h, 0) << c;
      ASSERT_EQ(posts.sources[c], 0U) << c;
    } else if (inside > -50) {
      ASSERT_TRUE(is_blended(posts.sources[c])) << c;
      ASSERT_EQ(layers.name(posts.sources[c]), "coarse") << c;
    }
    if (c > 0) {
      ASSERT_GE(h, posts.heights[c - 1] - 1e-4F) << c;
      steepest = std::max(steepest, static_cast<double>(h - posts.heights[c - 1]));
    }
    if (c > 1)
      curved = std::max(curved, std::abs(static_cast<double>(h - 2 * posts.heights[c - 1] + posts.heights[c - 2])));
  }
  // A smoothstep over n posts is at most 1.5 / n steep and changes its slope by at most 6 / n^2 from post to post. The
  // band is narrower by a few cells of its coarsest octave.
  EXPECT_LT(steepest, 100 * 3.0 / 64);
  EXPECT_LT(curved, 100 * 40.0 / (64 * 64));
  EXPECT_GT(posts.heights[127], 99) << "no cliff at the border";
}

// A layer with a slanted border, holes of all sizes, another layer between, all of them rough, and off the lattice.
struct Rough {
  Rough() {
    const auto noise = [](double scale) {
      return [scale](double lat, double lon) {
        return 300 * std::sin(lat * scale) * std::cos(lon * scale * 1.3) + 40 * std::sin(40 * lat + 31 * lon);
      };
    };
    write_coarse(folder, noise(1));
    write_float_tile(folder.path(), "middle", {17.1, 16.9, 50, 270, 290}, noise(1.1));
    write_float_tile(folder.path(), "fine", {15.01, 18.02, 200, 400, 420}, noise(1.2), [](double lat, double lon) {
      const double slanted = lat + 0.4 * lon;
      if (slanted < 20.6) return true;
      for (const double size : {0.006, 0.03, 0.15})
        if (std::hypot(lat - 14.3 - 2 * size, lon - 19 - 3 * size) < size) return true;
      return false;
    });
  }
  TemporaryFolder folder;
};

TEST(Layers, BendTheSameBitForBitFromAnyWindow) {
  const Rough rough;
  const Layers all(rough.folder.path());
  ASSERT_EQ(all.catalogue.rasters().size(), 3U);
  const PostWindow whole = window(8, 12.5, 17.5, 700, 800);
  const Posts expected = all.source.compose(whole);
  std::size_t bent = 0;
  for (const SourceMark s : expected.sources) bent += is_blended(s);
  EXPECT_GT(bent, expected.sources.size() / 5);
  EXPECT_LT(bent, expected.sources.size());
  std::mt19937 random(3);
  for (int k = 0; k < 60; ++k) {
    const Layers fresh(rough.folder.path());  // nothing is known of its borders yet
    PostWindow part = whole;
    part.rows = 1 + static_cast<int>(random() % (k % 10 == 0 ? 500 : 70));
    part.cols = 1 + static_cast<int>(random() % (k % 10 == 0 ? 500 : 70));
    const int r0 = static_cast<int>(random() % static_cast<unsigned>(whole.rows - part.rows)),
              c0 = static_cast<int>(random() % static_cast<unsigned>(whole.cols - part.cols));
    part.lat0 += static_cast<std::int64_t>(r0) * whole.lat_step;
    part.lon0 += static_cast<std::int64_t>(c0) * whole.lon_step;
    const Posts posts = (k % 2 ? fresh : all).source.compose(part);
    for (int r = 0; r < part.rows; ++r)
      for (int c = 0; c < part.cols; ++c) {
        const auto here = static_cast<std::size_t>(r * part.cols + c),
                   there = static_cast<std::size_t>((r0 + r) * whole.cols + c0 + c);
        ASSERT_EQ(posts.heights[here], expected.heights[there]) << k << ": " << r << ' ' << c;
        ASSERT_EQ(posts.sources[here], expected.sources[there]) << k << ": " << r << ' ' << c;
      }
  }
  // From another level of the lattice, too.
  PostWindow coarser = whole;
  coarser.lat_step *= 4, coarser.lon_step *= 2, coarser.rows /= 4, coarser.cols /= 2;
  const Posts posts = all.source.compose(coarser);
  for (int r = 0; r < coarser.rows; ++r)
    for (int c = 0; c < coarser.cols; ++c)
      ASSERT_EQ(posts.heights[static_cast<std::size_t>(r * coarser.cols + c)],
                expected.heights[static_cast<std::size_t>(4 * r * whole.cols + 2 * c)]);
}

// Three layers, however they lie to each other, at the date line, too; the finest has a hole.
TEST(Layers, PostsOfTheFinestLayerAreThoseOfItsFile) {
  const auto own = [](double scale) {
    return [scale](double lat, double lon) {
      return scale * 100 + 80 * std::sin(9 * lat + scale) * std::cos(7 * std::remainder(lon, 360));
    };
  };
  struct Place {
    double top, west;  // of the finest layer
  };
  for (const double east : {0.0, 161.0})  // 19 + 161 = 180
    for (const Place& at : {Place{15.5, 18.5}, {15.5, 17.5}, {16.5, 18}, {12.5, 21.25}, {17.0, 17.0}}) {
      SCOPED_TRACE(fmt::format("{} {} {}", east, at.top, at.west));
      TemporaryFolder folder;
      const auto lon = [&](double deg) { return deg + east > 180 ? deg + east - 360 : deg + east; };
      write_float_tile(folder.path(), "coarse", {20, lon(12), kCoarse, 161, 193}, own(1));
      write_float_tile(folder.path(), "middle", {17, lon(17), 64, 4 * 64 + 1, 4 * 64 + 1}, own(2));
      const auto is_hole = [&](double lat, double lon_deg) {
        return std::hypot(lat - at.top + 0.5, std::remainder(lon_deg - at.west - east - 0.6, 360)) < 0.1;
      };
      write_float_tile(folder.path(), "fine", {at.top, lon(at.west), 256, 257, 257}, own(3), is_hole);
      const Layers layers(folder.path());
      const PostWindow w = window(8, at.top - 1.25, at.west + east - 0.25, 385, 385);
      const Posts posts = layers.source.compose(w);
      std::size_t fine = 0;
      double step_m = 0;
      for (int r = 0; r < w.rows; ++r)
        for (int c = 0; c < w.cols; ++c) {
          const auto i = static_cast<std::size_t>(r * w.cols + c);
          const double lat = at.top - 1.25 + r / 256.0, lon_deg = at.west + east - 0.25 + c / 256.0;
          if (r > 0)
            step_m = std::max(
                step_m,
                std::abs(static_cast<double>(posts.heights[i] - posts.heights[i - static_cast<std::size_t>(w.cols)])));
          if (c > 0) step_m = std::max(step_m, std::abs(static_cast<double>(posts.heights[i] - posts.heights[i - 1])));
          if (layers.name(posts.sources[i]) != "fine") continue;
          ++fine;
          ASSERT_EQ(posts.sources[i], 2U);
          ASSERT_EQ(posts.heights[i], static_cast<float>(own(3)(lat, lon_deg))) << lat;
        }
      EXPECT_GT(fine, 60000U);
      EXPECT_LT(fine, 257U * 257U);
      // The relief's own steps are up to 3 m, a step between two layers without bending 100 to 260 m.
      EXPECT_LT(step_m, 12);
    }
}

// Two products of equal spacing on other grids overlap: the one that is named first is unchanged.
TEST(Layers, OfTwoEqualOnesTheFirstNamedIsUnchanged) {
  TemporaryFolder first, second;
  write_float_tile(first.path(), "b", {16, 18, kFine, 129, 129}, high);
  write_float_tile(second.path(), "a", {15 + 1.0 / 200, 19 + 1.0 / 300, kFine, 129, 129}, flat);
  write_float_tile(second.path(), "c", {15 + 1.0 / 200, 17 + 1.0 / 300, kFine, 64, 64}, flat);
  for (const bool swapped : {false, true}) {
    std::vector<std::string> paths{first.path(), second.path()};
    if (swapped) std::swap(paths[0], paths[1]);
    Catalogue catalogue(paths);
    ASSERT_EQ(catalogue.rasters().size(), 3U);
    ASSERT_EQ(catalogue.layer_begin(2), swapped ? 1 : 2) << "two layers";
    EXPECT_EQ(catalogue.rasters()[2].name, swapped ? "c" : "b");
    join_layers(catalogue, 16, {});
    const PostSource source(catalogue, false, [](const std::string&, const std::string&) {});
    const Posts posts = source.compose(window(6, 14.5, 19, 1, 2 * 64 + 1));
    const float above = swapped ? 0 : 100;
    float step_m = 0;
    for (std::size_t c = 0; c < posts.heights.size(); ++c) {
      const bool is_first = swapped ? c > 0 : c <= 64;  // on the first named layer's posts
      if (is_first && !is_blended(posts.sources[c])) {
        ASSERT_NEAR(posts.heights[c], above, 1e-3) << c;
      }
      if (c > 0 && !std::isnan(posts.heights[c] - posts.heights[c - 1]))
        step_m = std::max(step_m, std::abs(posts.heights[c] - posts.heights[c - 1]));
    }
    EXPECT_LT(step_m, 100 * 3.0 / 16);
  }
  // A file is named by its data as by its label.
  const Catalogue by_data(
      std::vector<std::string>{first.path() + "/b.img", second.path() + "/a.img", second.path() + "/c.img"});
  EXPECT_EQ(by_data.rasters()[2].name, "b");
  EXPECT_EQ(by_data.layer_begin(2), 2);
  EXPECT_EQ(by_data.layer_begin(1), 0);
  // Tiles of one grid are one layer, however they are named.
  TemporaryFolder tiles;
  write_float_tile(tiles.path(), "west", {16, 18, kFine, 256, 128}, high);
  write_float_tile(tiles.path(), "east", {16, 20, kFine, 256, 128}, high);
  const Catalogue one(std::vector<std::string>{tiles.path() + "/west.lbl", tiles.path() + "/east.lbl"});
  EXPECT_TRUE(one.one_layer());
}

TEST(Layers, HolesShowTheCoarserLayerAtTheHeightOfTheirBorder) {
  TemporaryFolder folder;
  write_coarse(folder);
  const double one = 14, many = 14.75;
  write_fine(folder, high, [&](double lat, double lon) {
    return (std::abs(lat - one) < 0.001 && std::abs(lon - 20) < 0.001) ||
           (std::abs(lat - many) < 0.05 && std::abs(lon - 20) < 0.05);
  });
  const Layers layers(folder.path());
  for (const double lat : {one, many}) {
    const Posts posts = layers.source.compose(window(6, lat, 20, 1, 64));
    EXPECT_EQ(layers.name(posts.sources[0]), "coarse");
    for (const float h : posts.heights) EXPECT_NEAR(h, 100, 0.01);
  }
}

TEST(Layers, SmallLayersBendTheCoarserOneOverItsPosts) {
  TemporaryFolder folder;
  write_coarse(folder);
  write_float_tile(folder.path(), "site", {14.1, 19.9, 512, 103, 103}, high);
  const Layers layers(folder.path());
  EXPECT_EQ(layers.source.bends().band_posts(1), 512);
  const Posts posts = layers.source.compose(window(9, 14, 18.5, 1, 1500));
  EXPECT_EQ(posts.heights[0], 0);
  for (std::size_t c = 1; c < posts.heights.size(); ++c) {
    const double lon = 18.5 + static_cast<double>(c) / 512;
    if (lon >= 19.9 && lon <= 20.1) {
      ASSERT_EQ(posts.heights[c], 100) << lon;
    }
    ASSERT_LT(std::abs(posts.heights[c] - posts.heights[c - 1]), 100 * 3.0 / 512) << lon;
  }
}

TEST(Layers, WithoutACoarserLayerAreNotBlended) {
  TemporaryFolder folder;
  // The coarse layer ends where the fine one does, in the west.
  write_float_tile(folder.path(), "coarse", {20, 18, kCoarse, 161, 161}, flat);
  write_fine(folder);
  const Layers layers(folder.path());
  const Posts posts = layers.source.compose(window(6, 14, 18, 1, 128));
  for (std::size_t c = 0; c < posts.heights.size(); ++c) ASSERT_EQ(posts.heights[c], 100) << c;
}

TEST(Layers, TheSeamsOfCoarserTilesBendAsOne) {
  TemporaryFolder folder;
  // Coarse tiles as Kaguya's are, a post apart; the fine layer begins on the seam of two and lies over another.
  const auto slope = [](double lat, double lon) { return 10 * lat - 5 * lon; };
  for (const int top : {14, 16})
    for (const int west : {16, 18, 20, 22})
      write_float_tile(folder.path(), "coarse" + std::to_string(top) + std::to_string(west),
                       {static_cast<double>(top), static_cast<double>(west), 16, 32, 32}, slope);
  write_float_tile(folder.path(), "fine", {15.5, 18, 64, 192, 240},
                   [&](double lat, double lon) { return slope(lat, lon) + 100; });
  const Layers layers(folder.path());
  const PostWindow w = window(6, 13, 17, 128, 64 * 5);
  const Posts posts = layers.source.compose(w);
  for (int r = 0; r < w.rows; ++r)
    for (int c = 0; c < w.cols; ++c) {
      const auto at = static_cast<std::size_t>(r * w.cols + c);
      const double above = static_cast<double>(posts.heights[at]) - slope(13 + r / 64.0, 17 + c / 64.0);
      ASSERT_FALSE(is_filled(posts.sources[at])) << r << ' ' << c;
      if (layers.name(posts.sources[at]) == "fine") {
        ASSERT_NEAR(above, 100, 0.01) << r << ' ' << c;
      }
      if (c > 0) {
        const double before = static_cast<double>(posts.heights[at - 1]) - slope(13 + r / 64.0, 17 + (c - 1) / 64.0);
        ASSERT_LT(std::abs(above - before), 100 * 3.0 / 64) << r << ' ' << c;
      }
    }
}

TEST(Layers, OffsetsAreAddedAndPartOfTheFingerprint) {
  TemporaryFolder folder;
  write_coarse(folder), write_fine(folder);
  const Layers plain(folder.path()), moved(folder.path(), 16, {{"fi*", -7.5}}), narrow(folder.path(), 8);
  EXPECT_EQ(moved.source.compose(window(6, 14, 20, 1, 1)).heights[0], 92.5F);
  EXPECT_NE(plain.catalogue.fingerprint(), moved.catalogue.fingerprint());
  EXPECT_NE(plain.catalogue.fingerprint(), narrow.catalogue.fingerprint());
  EXPECT_EQ(plain.catalogue.fingerprint(), Layers(folder.path()).catalogue.fingerprint());
  EXPECT_THROW(Layers(folder.path(), 16, {{"nothing*", 1.0}}), DataError);
  // Of a single layer, the band means nothing.
  TemporaryFolder single;
  write_coarse(single);
  EXPECT_EQ(Layers(single.path(), 16).catalogue.fingerprint(), Layers(single.path(), 8).catalogue.fingerprint());
}

TEST(Layers, FitRecoversAKnownBias) {
  const auto truth = [](double lat, double lon) { return 200 * std::sin(lat) + 150 * std::cos(1.3 * lon); };
  TemporaryFolder folder;
  write_coarse(folder, truth);
  write_fine(folder, [&](double lat, double lon) {
    // An eighth of the border is off by much: a mean would follow it.
    const double spike = lon > 21.9 && lat > 13.5 && lat < 15.5 ? 500 : 0;
    return truth(lat, lon) + 23.75 + spike;
  });
  const Layers layers(folder.path(), 16, {{"fine", std::nullopt}});
  ASSERT_EQ(layers.fits.size(), 1U);
  EXPECT_GT(layers.fits[0].posts, 100U);
  EXPECT_NEAR(layers.fits[0].offset_m, -23.75, 0.3);  // the coarse layer's interpolation
  EXPECT_EQ(layers.catalogue.offset_m(1), layers.fits[0].offset_m);

  const std::vector<LayerBorder> borders = measure_borders(layers.catalogue, 10);
  ASSERT_EQ(borders.size(), 1U);
  EXPECT_EQ(borders[0].beneath, 0);
  EXPECT_GT(borders[0].in_files.mean_m, 23);
  EXPECT_GT(borders[0].in_files.worst_m, 500);
  EXPECT_NEAR(borders[0].bent.mean_m, borders[0].in_files.mean_m + borders[0].offset_m, 1e-3);
  EXPECT_EQ(borders[0].offset_m, layers.fits[0].offset_m);
}

TEST(Layers, TilesOfOneLayerAreFittedAsOne) {
  TemporaryFolder folder;
  write_coarse(folder);
  // On the west side 10 m too high, on the east 30: one offset, or a cliff would stand between them.
  write_float_tile(folder.path(), "west", {16, 18, kFine, 256, 128}, [](double, double) { return 10.0; });
  write_float_tile(folder.path(), "east", {16, 20, kFine, 256, 128}, [](double, double) { return 30.0; });
  write_float_tile(folder.path(), "away", {19, 11, kFine, 64, 64}, [](double, double) { return -5.0; });
  const Layers layers(folder.path(), 16,
                      {{"*", 0.0}, {"?est", std::nullopt}, {"east", std::nullopt}, {"away", std::nullopt}});
  ASSERT_EQ(layers.fits.size(), 2U);
  const auto offset = [&](const char* name) {
    for (std::size_t i = 0; i < layers.catalogue.rasters().size(); ++i)
      if (layers.catalogue.rasters()[i].name == name) return layers.catalogue.offset_m(static_cast<int>(i));
    return std::nan("");
  };
  EXPECT_EQ(offset("west"), offset("east"));
  EXPECT_NEAR(offset("west"), -20, 10);
  EXPECT_EQ(offset("away"), 5);
  EXPECT_EQ(offset("coarse"), 0);
}

TEST(Layers, OffsetsAreReadFromText) {
  EXPECT_EQ(parse_layer_offset("NAC_*=-12.5").value, -12.5);
  EXPECT_EQ(parse_layer_offset("a=b=fit").pattern, "a=b");
  EXPECT_FALSE(parse_layer_offset("x=fit").value);
  for (const char* wrong : {"", "x", "=3", "x=", "x=3m", "x=nan", "x=inf", "x=1e9"})
    EXPECT_THROW(parse_layer_offset(wrong), std::invalid_argument) << wrong;
}

TEST(ResolvedPosts, AreSaidByName) {
  EXPECT_EQ(parse_resolved_posts("a=8").value, 8);
  for (const char* wrong : {"a=0.5", "a=64", "a", "a=x"})
    EXPECT_THROW(parse_resolved_posts(wrong), std::invalid_argument);
  TemporaryFolder folder;
  write_coarse(folder);
  Catalogue catalogue(std::vector<std::string>{folder.path()});
  const std::uint64_t before = catalogue.fingerprint();
  resolve_posts(catalogue, {{"coarse", 4}});
  EXPECT_EQ(catalogue.resolved_posts(0), 4);
  EXPECT_NE(catalogue.fingerprint(), before);
  EXPECT_THROW(resolve_posts(catalogue, {{"other", 2}}), DataError);
}

// Self-affine ground of Hurst exponent 0.8, through every n-th post: linearly, or by Catmull and Rom.
class Interpolated {
 public:
  Interpolated(int posts, bool linear) : posts_(posts), linear_(linear), side_(kSide / posts + 5) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> any(0, 360);
    std::vector<double> known(static_cast<std::size_t>(side_ * side_));
    for (double wave = 1.5 * posts; wave < 2 * kSide; wave *= 1.02) {
      const double turn = any(random) * kRadiansPerDegree, phase = any(random),
                   k = 360 * kRadiansPerDegree * posts / wave;
      const double height = std::pow(wave, 0.8);
      for (int y = 0; y < side_; ++y)
        for (int x = 0; x < side_; ++x)
          known[static_cast<std::size_t>(y * side_ + x)] +=
              height * std::sin(k * (x * std::cos(turn) + y * std::sin(turn)) + phase);
    }
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) heights_.push_back(between(known, y, x));
    double sum = 0;
    for (int y = 4; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) sum += std::pow((at(y, x) - at(y - 4, x)) / 4, 2);
    rise_ = std::sqrt(sum / (kSide * (kSide - 4)));
  }

  static constexpr int kSide = 256;
  // In posts of 7.4 m, of this slope over 4 of them.
  double height_m(int y, int x, double slope_deg) const {
    return at(y, x) / rise_ * 7.4 * std::tan(slope_deg * kRadiansPerDegree);
  }

 private:
  double at(int y, int x) const { return heights_[static_cast<std::size_t>(y * kSide + x)]; }
  std::array<double, 4> weights(double u) const {
    if (linear_) return {0, 1 - u, u, 0};
    return {u * (-0.5 + u * (1 - 0.5 * u)), 1 + u * u * (1.5 * u - 2.5), u * (0.5 + u * (2 - 1.5 * u)),
            u * u * (0.5 * u - 0.5)};
  }
  double between(const std::vector<double>& known, int y, int x) const {
    const auto rows = weights(y % posts_ / static_cast<double>(posts_)),
               columns = weights(x % posts_ / static_cast<double>(posts_));
    double sum = 0;
    for (std::size_t r = 0; r < 4; ++r)
      for (std::size_t c = 0; c < 4; ++c) {
        const std::size_t row = static_cast<std::size_t>(y / posts_) + r,
                          column = static_cast<std::size_t>(x / posts_) + c;
        sum += rows[r] * columns[c] * known[row * static_cast<std::size_t>(side_) + column];
      }
    return sum;
  }

  int posts_;
  bool linear_;
  int side_;
  std::vector<double> heights_;
  double rise_ = 0;
};

// Whatever it was interpolated by, in whole metres, too. Where these hide it, nothing is claimed.
TEST(ResolvedPosts, AreMeasuredInInterpolatedGround) {
  constexpr int kPpd = Interpolated::kSide;
  for (const int posts : {1, 2, 4, 8, 16})
    for (const bool linear : {true, false}) {
      if (posts == 16 && !linear) continue;  // growth wants more of them
      const Interpolated ground(posts, linear);
      for (const double slope_deg : {1.0, 2.0, 4.0, 8.0, 20.0}) {
        const auto height_m = [&](double lat, double lon) {
          return ground.height_m(static_cast<int>(std::lround((1 - lat) * kPpd)),
                                 static_cast<int>(std::lround((lon - 3) * kPpd)), slope_deg);
        };
        for (const bool whole_metres : {false, true}) {
          TemporaryFolder folder;
          if (whole_metres)
            test::write_kaguya_tile(folder.path(), 1, 3, 1, kPpd, height_m);
          else
            write_float_tile(folder.path(), "real", {1, 3, kPpd, kPpd, kPpd}, height_m);
          const Catalogue catalogue(std::vector<std::string>{folder.path()});
          const int found = measure_resolved_posts(catalogue, {0});
          const std::string which = std::to_string(posts) + (linear ? " linear " : " cubic ") +
                                    std::to_string(slope_deg) + (whole_metres ? " int16" : " float");
          if (whole_metres && slope_deg < 4 && found == 0) continue;
          EXPECT_EQ(found, posts) << which;
        }
      }
    }
}

// What is coarse goes on into a chunk of fine posts: on its side the coarse layer's bicubic surface, on the other
// triangles between coarse posts. Places one fine post apart.
TEST(Layers, NoWallStandsWhereAChunkOfFinePostsEnds) {
  struct Place {
    double lat_deg, lon_deg, relief_m;
    bool parallel;  // across a border that is one
  };
  // Chunks of level 6 end at whole degrees, near the pole at every fourth of longitude.
  for (const Place& p :
       {Place{0.46, 3, 200, false}, {1, 2.46, 200, true}, {-84.54, 4, 20, false}, {-84, 2.46, 20, true}}) {
    TemporaryFolder folder;
    std::mt19937 random(7);
    std::uniform_real_distribution<double> relief(-p.relief_m, p.relief_m);
    const auto rough = [&](double, double) { return relief(random); };
    write_float_tile(folder.path(), "coarse", {p.lat_deg < 0 ? -80.0 : 6.0, -6, 16, 8 * 16 + 1, 24 * 16 + 1}, rough);
    write_float_tile(folder.path(), "fine", {p.lat_deg < 0 ? -84.5 : 0.5, 2.5, 4096, 80, 80}, flat);
    const auto terrain = test::open_terrain(folder.path());
    constexpr double kPost_deg = 1 / 4096.0;
    const auto height = [&](double along_deg, int posts) {
      const double lat = p.parallel ? p.lat_deg + posts * kPost_deg : p.lat_deg + along_deg,
                   lon = p.parallel ? p.lon_deg + along_deg : p.lon_deg + posts * kPost_deg * (p.lat_deg < 0 ? 4 : 1);
      return terrain->height(lat, lon).height_m;
    };
    double elsewhere = 0, there = 0;
    for (double along_deg = 0; along_deg < 0.0625; along_deg += 0.0031)
      for (int posts = -20; posts < 20; ++posts) {
        const double step_m = std::abs(height(along_deg, posts + 1) - height(along_deg, posts));
        double& steepest = posts == 0 || posts == -1 ? there : elsewhere;
        steepest = std::max(steepest, step_m);
      }
    EXPECT_LT(there, 1.5 * elsewhere) << p.lat_deg << " N, " << p.lon_deg << " E: " << there << " and " << elsewhere;
    EXPECT_GT(elsewhere, 0.05);
  }
}

// Around the corner of a chunk of fine posts: a window's heights are those of any other, of its own spacing or another.
TEST(Layers, JoinFinePostsWithCoarseTrianglesTheSameFromAnyWindow) {
  TemporaryFolder folder;
  std::mt19937 random(7);
  std::uniform_real_distribution<double> relief(-200, 200);
  write_float_tile(folder.path(), "coarse", {6, -6, 16, 8 * 16 + 1, 24 * 16 + 1},
                   [&](double, double) { return relief(random); });
  write_float_tile(folder.path(), "fine", {0.5, 2.5, 4096, 80, 80}, flat);
  // Without bending, which reaches farther than triangles.
  const Layers all(folder.path(), 0), coarse_only(folder.path() + "/coarse.lbl");
  constexpr int kSide = 240;
  const PostWindow whole = window(12, 1 - 0.03, 3 - 0.03, kSide, kSide);
  const Posts posts = all.source.compose(whole), plain = coarse_only.source.compose(whole);
  EXPECT_NE(posts.heights, plain.heights) << "nothing is joined";
  for (const int step : {1, 2, 8})
    for (const int first : {0, 40, 88, 127, 160}) {
      PostWindow part = whole;
      part.lat_step *= step, part.lon_step *= step;
      part.lat0 += first * whole.lat_step, part.lon0 += (first / 2) * whole.lon_step;
      part.rows = (kSide - 1 - first) / step + 1, part.cols = 40 / step;
      const Posts other = all.source.compose(part);
      for (int r = 0; r < part.rows; ++r)
        for (int c = 0; c < part.cols; ++c)
          ASSERT_EQ(other.heights[static_cast<std::size_t>(r * part.cols + c)],
                    posts.heights[static_cast<std::size_t>((first + r * step) * kSide + first / 2 + c * step)])
              << step << " " << first << ": " << r << " " << c;
    }
  // Beyond a quad of the coarser side from its border, and on its posts, the coarse layer is as it was.
  for (std::size_t i = 0; i < posts.heights.size(); ++i) {
    const std::int64_t lat = whole.lat0 + static_cast<std::int64_t>(i / kSide) * whole.lat_step - 91 * kTicksPerDegree,
                       lon = whole.lon0 + static_cast<std::int64_t>(i % kSide) * whole.lon_step - 183 * kTicksPerDegree;
    constexpr std::int64_t kQuad = kTicksPerDegree / 64;
    if ((std::abs(lat) >= kQuad && std::abs(lon) >= kQuad) || (lat % kQuad == 0 && lon % kQuad == 0)) {
      ASSERT_EQ(posts.heights[i], plain.heights[i]) << i;
    }
  }
}

}  // namespace
}  // namespace selenograph::dem
