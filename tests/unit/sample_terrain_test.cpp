// The sample terrain: Kaguya's format to the byte, seams that can't be told from the inside, craters as in the papers.
#include "dem/sample/sample_terrain.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "dem/base/error.h"
#include "dem/sample/crater_profile.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

using namespace sample;

namespace fs = std::filesystem;

constexpr int kDummy = -9999;

std::string file_bytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  EXPECT_TRUE(file) << path;
  return {std::istreambuf_iterator<char>(file), {}};
}

struct Posts {
  int size = 0;
  std::vector<int> height;
  int at(int row, int column) const { return height[static_cast<std::size_t>(row * size + column)]; }
};

// Decodes the image as the label says: most significant byte first.
Posts posts_of(const std::string& path) {
  const std::string bytes = file_bytes(path);
  Posts posts;
  posts.size = static_cast<int>(std::lround(std::sqrt(static_cast<double>(bytes.size() / 2))));
  for (std::size_t i = 0; i + 1 < bytes.size(); i += 2) {
    const int high = static_cast<unsigned char>(bytes[i]), low = static_cast<unsigned char>(bytes[i + 1]);
    posts.height.push_back(static_cast<std::int16_t>(high << 8 | low));
  }
  return posts;
}

std::map<std::string, std::string> members_of(const std::string& label) {
  std::map<std::string, std::string> members;
  for (std::size_t begin = 0, end; (end = label.find("\r\n", begin)) != std::string::npos; begin = end + 2) {
    const std::string line = label.substr(begin, end - begin);
    const std::size_t equals = line.find("= ");
    if (equals == std::string::npos) continue;
    const std::size_t first = line.find_first_not_of(' ');
    members[line.substr(first, line.find_first_of(" =", first) - first)] = line.substr(equals + 2);
  }
  return members;
}

SampleOptions small(int south_deg, int west_deg, int rows, int columns, int posts_per_degree = 128) {
  SampleOptions o;
  o.south_deg = south_deg, o.west_deg = west_deg, o.rows = rows, o.columns = columns;
  o.posts_per_degree = posts_per_degree;
  return o;
}

// Root mean square of the second difference across a line between b and c: near zero on smooth ground, and large if the
// two sides did not belong together.
struct Roughness {
  double sum = 0;
  int count = 0;
  void add(int a, int b, int c, int d) {
    if (a == kDummy || b == kDummy || c == kDummy || d == kDummy) return;
    const double jump = (c - b) - 0.5 * ((b - a) + (d - c));
    sum += jump * jump;
    ++count;
  }
  double rms() const { return std::sqrt(sum / count); }
};

double across_columns(const Posts& west, int column_west, const Posts& east, int column_east) {
  Roughness r;
  for (int row = 0; row < west.size; ++row) {
    r.add(west.at(row, column_west - 1), west.at(row, column_west), east.at(row, column_east),
          east.at(row, column_east + 1));
  }
  return r.rms();
}

double across_rows(const Posts& north, int row_north, const Posts& south, int row_south) {
  Roughness r;
  for (int column = 0; column < north.size; ++column) {
    r.add(north.at(row_north - 1, column), north.at(row_north, column), south.at(row_south, column),
          south.at(row_south + 1, column));
  }
  return r.rms();
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<long>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

// The seam between two tiles is as rough as the lines inside them. (Tiles that don't belong together differ by a
// hundred metres; a crater drawn on one side only, by tens.)
void expect_meets_to_the_east(const Posts& west, const Posts& east) {
  std::vector<double> inside;
  for (int c = west.size * 3 / 4; c < west.size - 2; ++c) inside.push_back(across_columns(west, c, west, c + 1));
  for (int c = 1; c < west.size / 4; ++c) inside.push_back(across_columns(east, c, east, c + 1));
  EXPECT_LT(across_columns(west, west.size - 1, east, 0), 1.5 * median(inside));
  EXPECT_GT(across_columns(east, east.size - 1, west, 0), 3 * median(inside)) << "the measure would not see a bad seam";
}

void expect_meets_to_the_south(const Posts& north, const Posts& south) {
  std::vector<double> inside;
  for (int r = north.size * 3 / 4; r < north.size - 2; ++r) inside.push_back(across_rows(north, r, north, r + 1));
  for (int r = 1; r < north.size / 4; ++r) inside.push_back(across_rows(south, r, south, r + 1));
  EXPECT_LT(across_rows(north, north.size - 1, south, 0), 1.5 * median(inside));
  EXPECT_GT(across_rows(south, south.size - 1, north, 0), 3 * median(inside)) << "the measure would not see a bad seam";
}

TEST(SampleTerrain, NamesFollowSldem2013) {
  test::TemporaryFolder folder;
  const auto labels = write_sample_terrain(folder.path(), small(-1, 359, 2, 2, 16));
  std::vector<std::string> names;
  for (const auto& label : labels) names.push_back(fs::path(label).filename().string());
  EXPECT_EQ(names, (std::vector<std::string>{"DTM_MAP_01_N01E359N00E000SC.lbl", "DTM_MAP_01_N01E000N00E001SC.lbl",
                                             "DTM_MAP_01_N00E359S01E000SC.lbl", "DTM_MAP_01_N00E000S01E001SC.lbl"}));
  for (const auto& entry : fs::directory_iterator(folder.path())) EXPECT_NE(entry.path().extension(), ".part");
}

TEST(SampleTerrain, SameOptionsSameBytesAloneOrInAMosaic) {
  test::TemporaryFolder mosaic, again, alone, other;
  write_sample_terrain(mosaic.path(), small(-11, 43, 2, 2));
  write_sample_terrain(again.path(), small(-11, 43, 2, 2));
  write_sample_terrain(alone.path(), small(-11, 44, 1, 1));
  SampleOptions reseeded = small(-11, 44, 1, 1);
  ++reseeded.seed;
  write_sample_terrain(other.path(), reseeded);
  const std::string tile = "DTM_MAP_01_S10E044S11E045SC";
  for (const char* extension : {".img", ".lbl"}) {
    EXPECT_EQ(file_bytes(mosaic / (tile + extension)), file_bytes(again / (tile + extension)));
    EXPECT_EQ(file_bytes(mosaic / (tile + extension)), file_bytes(alone / (tile + extension)));
  }
  EXPECT_NE(file_bytes(mosaic / (tile + ".img")), file_bytes(other / (tile + ".img")));
}

TEST(SampleTerrain, LabelIsKaguyasAndTrue) {
  test::TemporaryFolder folder;
  write_sample_terrain(folder.path(), small(-11, 43, 1, 1, 256));
  const std::string name = "DTM_MAP_01_S10E043S11E044SC", label = file_bytes(folder / (name + ".lbl"));
  EXPECT_EQ(std::count(label.begin(), label.end(), '\n'), std::count(label.begin(), label.end(), '\r'));
  EXPECT_TRUE(label.ends_with("\r\nEND\r\n"));
  auto m = members_of(label);
  EXPECT_EQ(m["^IMAGE"], "(\"" + name + ".img\", 1 <BYTES>)");
  EXPECT_EQ(m["PRODUCT_ID"], '"' + name + '"');
  EXPECT_NE(m["DATA_SET_ID"].find("SYNTHETIC"), std::string::npos);
  EXPECT_EQ(m["UPPER_LEFT_LATITUDE"], "-10.000000 <deg>");
  EXPECT_EQ(m["LOWER_RIGHT_LONGITUDE"], "43.996094 <deg>");
  EXPECT_EQ(m["MAP_RESOLUTION"], "256.000000 <pixel/deg>");
  EXPECT_EQ(m["MAP_SCALE"], "0.1184505875943339 <km/pixel>");  // as on JAXA's own label at this resolution
  EXPECT_EQ(m["LINE_PROJECTION_OFFSET"], "-2560.000000 <pixel>");
  EXPECT_EQ(m["SAMPLE_PROJECTION_OFFSET"], "-11008.000000 <pixel>");
  EXPECT_EQ(m["SAMPLE_TYPE"], "MSB_INTEGER");
  EXPECT_EQ(m["DUMMY"], "-9999");

  const Posts posts = posts_of(folder / (name + ".img"));
  ASSERT_EQ(posts.size, 256);
  double sum = 0, squares = 0, n = 0;
  int low = 32767, high = -32768;
  for (const int h : posts.height) {
    if (h == kDummy) continue;
    sum += h, squares += static_cast<double>(h) * h, n += 1;
    low = std::min(low, h), high = std::max(high, h);
  }
  EXPECT_EQ(std::stoi(m["MINIMUM"]), low);
  EXPECT_EQ(std::stoi(m["MAXIMUM"]), high);
  EXPECT_NEAR(std::stod(m["AVERAGE"]), sum / n, 1e-5);
  EXPECT_NEAR(std::stod(m["STDEV"]), std::sqrt(squares / n - sum / n * sum / n), 1e-4);
  // Read with the wrong byte order, neighbours would differ by thousands of metres.
  EXPECT_LT(high, 4000);
  EXPECT_GT(low, -6000);
}

TEST(SampleTerrain, VoidsAreFewAndOneIsAFewDozenPosts) {
  test::TemporaryFolder folder;
  write_sample_terrain(folder.path(), small(-11, 43, 1, 1, 256));
  Posts posts = posts_of(folder / "DTM_MAP_01_S10E043S11E044SC.img");
  std::vector<int> sizes;
  for (int start = 0; start < 256 * 256; ++start) {  // flood fill
    if (posts.height[static_cast<std::size_t>(start)] != kDummy) continue;
    sizes.push_back(0);
    for (std::vector<int> open{start}; !open.empty();) {
      const int p = open.back();
      open.pop_back();
      if (posts.height[static_cast<std::size_t>(p)] != kDummy) continue;
      posts.height[static_cast<std::size_t>(p)] = 0;
      ++sizes.back();
      if (p % 256 > 0) open.push_back(p - 1);
      if (p % 256 < 255) open.push_back(p + 1);
      if (p >= 256) open.push_back(p - 256);
      if (p < 255 * 256) open.push_back(p + 256);
    }
  }
  ASSERT_GE(sizes.size(), 3u);
  EXPECT_LE(sizes.size(), 5u);
  std::sort(sizes.begin(), sizes.end());
  EXPECT_GE(sizes.back(), 20);
  EXPECT_LE(sizes.back(), 60);
  EXPECT_LE(sizes.front(), 6);
}

TEST(SampleTerrain, TilesMeet) {
  test::TemporaryFolder folder;
  write_sample_terrain(folder.path(), small(-11, 43, 2, 2, 256));
  const Posts nw = posts_of(folder / "DTM_MAP_01_S09E043S10E044SC.img");
  const Posts ne = posts_of(folder / "DTM_MAP_01_S09E044S10E045SC.img");
  const Posts sw = posts_of(folder / "DTM_MAP_01_S10E043S11E044SC.img");
  const Posts se = posts_of(folder / "DTM_MAP_01_S10E044S11E045SC.img");
  expect_meets_to_the_east(nw, ne);
  expect_meets_to_the_east(sw, se);
  expect_meets_to_the_south(nw, sw);
  expect_meets_to_the_south(ne, se);
}

TEST(SampleTerrain, TilesMeetAcrossTheDateLineAndTheZeroMeridian) {
  test::TemporaryFolder folder;
  SampleOptions o = small(-1, 359, 1, 2, 256);
  o.date_line = true;
  EXPECT_EQ(write_sample_terrain(folder.path(), o).size(), 4u);
  expect_meets_to_the_east(posts_of(folder / "DTM_MAP_01_N00E179S01E180SC.img"),
                           posts_of(folder / "DTM_MAP_01_N00E180S01E181SC.img"));
  expect_meets_to_the_east(posts_of(folder / "DTM_MAP_01_N00E359S01E000SC.img"),
                           posts_of(folder / "DTM_MAP_01_N00E000S01E001SC.img"));
}

TEST(SampleTerrain, ThePoleIsOnePointInEveryTile) {
  test::TemporaryFolder folder;
  write_sample_terrain(folder.path(), small(89, 0, 1, 360, 16));
  std::vector<int> heights;
  for (const auto& entry : fs::directory_iterator(folder.path())) {
    if (entry.path().extension() != ".img") continue;
    const Posts posts = posts_of(entry.path().string());
    for (int c = 0; c < posts.size; ++c) {
      if (posts.at(0, c) != kDummy) heights.push_back(posts.at(0, c));
    }
  }
  ASSERT_GT(heights.size(), 5000u);
  EXPECT_EQ(*std::min_element(heights.begin(), heights.end()), *std::max_element(heights.begin(), heights.end()));
}

// A post at the same place is drawn from the same large craters at any resolution; only small craters are added.
TEST(SampleTerrain, ResolutionsAgree) {
  test::TemporaryFolder coarse, fine;
  write_sample_terrain(coarse.path(), small(-11, 43, 1, 1, 64));
  write_sample_terrain(fine.path(), small(-11, 43, 1, 1, 256));
  const std::string name = "DTM_MAP_01_S10E043S11E044SC.img";
  const Posts a = posts_of(coarse / name), b = posts_of(fine / name);
  std::vector<int> differences;
  for (int r = 0; r < 64; ++r) {
    for (int c = 0; c < 64; ++c) {
      if (a.at(r, c) == kDummy || b.at(4 * r, 4 * c) == kDummy) continue;
      differences.push_back(std::abs(a.at(r, c) - b.at(4 * r, 4 * c)));
    }
  }
  std::sort(differences.begin(), differences.end());
  EXPECT_LT(differences[differences.size() / 2], 10);          // median
  EXPECT_LT(differences[differences.size() * 99 / 100], 200);  // inside craters below 1.4 km: 0.2 D at most
}

TEST(SampleTerrain, SlopesAreLunar) {
  test::TemporaryFolder folder;
  write_sample_terrain(folder.path(), small(-11, 43, 1, 1, 512));
  const Posts posts = posts_of(folder / "DTM_MAP_01_S10E043S11E044SC.img");
  const double step_m = kMoonRadius_m * 3.14159265358979 / 180 / 512;
  std::vector<double> slopes;
  for (int r = 1; r < posts.size - 1; ++r) {
    for (int c = 1; c < posts.size - 1; ++c) {
      const int w = posts.at(r, c - 1), e = posts.at(r, c + 1), n = posts.at(r - 1, c), s = posts.at(r + 1, c);
      if (std::min({w, e, n, s}) == kDummy) continue;
      slopes.push_back(std::atan(std::hypot(e - w, n - s) / (2 * step_m)) * 180 / 3.14159265358979);
    }
  }
  std::sort(slopes.begin(), slopes.end());
  const auto share = [&](double q) {
    return slopes[static_cast<std::size_t>(q * static_cast<double>(slopes.size() - 1))];
  };
  EXPECT_GT(share(0.5), 2);
  EXPECT_LT(share(0.5), 12);
  EXPECT_LT(share(0.98), 35);
  EXPECT_LT(share(1.0), 65);
}

TEST(SampleTerrain, ProgressRisesToOne) {
  test::TemporaryFolder folder;
  std::vector<double> seen;
  write_sample_terrain(folder.path(), small(-11, 43, 1, 2), [&](double done) { seen.push_back(done); });
  ASSERT_FALSE(seen.empty());
  EXPECT_TRUE(std::is_sorted(seen.begin(), seen.end()));
  EXPECT_DOUBLE_EQ(seen.back(), 1.0);
}

TEST(SampleTerrain, ImpossibleOptionsAreErrors) {
  test::TemporaryFolder folder;
  EXPECT_THROW(write_sample_terrain(folder.path(), small(-11, 43, 1, 1, 1000)), std::invalid_argument);
  EXPECT_THROW(write_sample_terrain(folder.path(), small(89, 43, 2, 1)), std::invalid_argument);
  EXPECT_THROW(write_sample_terrain(folder.path(), small(0, 43, 0, 1)), std::invalid_argument);
  EXPECT_THROW(write_sample_terrain("/dev/null/nowhere", small(0, 43, 1, 1)), DataError);
}

// ---- craters --------------------------------------------------------------------------------------------------------

Crater crater(double diameter_m, double degradation) {
  Crater c;
  c.diameter_m = diameter_m;
  c.degradation = degradation;
  c.id = 12345;
  return c;
}

// Mean over azimuth.
double ring_m(const CraterShape& shape, double radius_m) {
  double sum = 0;
  for (int i = 0; i < 360; ++i) {
    const double azimuth = i * 3.14159265358979 / 180;
    sum += shape.trace(radius_m * std::cos(azimuth), radius_m * std::sin(azimuth)).height_m;
  }
  return sum / 360;
}

double crest_m(const CraterShape& shape, double diameter_m) {
  double highest = -1e9;
  for (double x = 0.8; x < 1.3; x += 0.01) highest = std::max(highest, ring_m(shape, x * diameter_m / 2));
  return highest;
}

TEST(Craters, FreshSimpleOnesAreAFifthAsDeepAsWide) {
  for (const double d : {200.0, 1000.0, 5000.0}) {
    const CraterShape shape(crater(d, 0));
    const double depth = crest_m(shape, d) - ring_m(shape, 0);
    EXPECT_NEAR(depth / d, 0.196, 0.02) << d;  // Pike 1977
    EXPECT_NEAR(crest_m(shape, d) / d, 0.036, 0.008) << d;
  }
}

TEST(Craters, LargeOnesAreShallowerAsPikeMeasured) {
  const double d = 30000;
  const CraterShape shape(crater(d, 0));
  const double floor = ring_m(shape, 0.3 * d / 2);  // outside the peak
  EXPECT_NEAR(crest_m(shape, d) - floor, 1044 * std::pow(30, 0.301), 450);
}

TEST(Craters, PeaksAboveTwentyKilometres) {
  const auto rise = [](double d) {
    const CraterShape shape(crater(d, 0));
    return ring_m(shape, 0) - ring_m(shape, 0.3 * d / 2);
  };
  EXPECT_LT(rise(12000), 100);
  EXPECT_LT(rise(19000), 100);
  EXPECT_GT(rise(30000), 250);
  EXPECT_GT(rise(50000), 700);
}

TEST(Craters, EjectaFadeOutwardsAndEnd) {
  const CraterShape shape(crater(1000, 0));
  const double rim = ring_m(shape, 500);
  EXPECT_LT(ring_m(shape, 750), 0.5 * rim);
  EXPECT_GT(ring_m(shape, 750), 0.1 * rim);
  EXPECT_LT(ring_m(shape, 1200), ring_m(shape, 750));
  EXPECT_EQ(shape.trace(shape.reach_m(), 0).height_m, 0);
  EXPECT_EQ(shape.trace(shape.reach_m(), 0).keep, 1);
}

TEST(Craters, AgeShrinksDepthAndRim) {
  double depth = 1e9, rim = 1e9;
  for (const double degradation : {0.0, 0.01, 0.05, 0.2, 0.4}) {
    const CraterShape shape(crater(1000, degradation));
    const double crest = crest_m(shape, 1000);
    EXPECT_LT(crest - ring_m(shape, 0), depth);
    EXPECT_LT(crest, rim);
    depth = crest - ring_m(shape, 0), rim = crest;
  }
  EXPECT_LT(depth, 40);  // a fifth of what it was
}

TEST(Craters, SizesFollowAPowerLaw) {
  const double area_km2 = [] {
    const double r = kMoonRadius_m * 1e-3, degree = 3.14159265358979 / 180;
    return r * r * 10 * degree * std::sin(10 * degree);
  }();
  // Since the maria: -2 above 1.5 km, steeper below. Everything: the equilibrium's -2.
  const auto all = craters_reaching({0, 10, 0, 10}, 7, 500);
  const auto count = [&](double d_m, bool young) {
    return static_cast<double>(std::count_if(all.begin(), all.end(), [&](const Crater& c) {
      return c.diameter_m >= d_m && (!young || c.age < 1) && c.lat_deg >= 0 && c.lat_deg < 10 && c.lon_deg >= 0 &&
             c.lon_deg < 10;
    }));
  };
  EXPECT_NEAR(std::log2(count(2000, false) / count(4000, false)), 2, 0.15);
  EXPECT_NEAR(std::log2(count(500, false) / count(1000, false)), 2, 0.1);
  EXPECT_NEAR(std::log2(count(600, true) / count(1200, true)), 3, 0.25);
  EXPECT_NEAR(count(1000, false) / area_km2, highland_density_per_km2(1), 0.05 * highland_density_per_km2(1));
  EXPECT_NEAR(count(1000, true) / area_km2, mare_density_per_km2(1), 0.2 * mare_density_per_km2(1));
}

TEST(Craters, NeighboursAndResolutionsMeetTheSameOnes) {
  const auto ids = [](const std::vector<Crater>& craters, double least_m) {
    std::vector<std::uint64_t> all;
    for (const Crater& c : craters) {
      if (c.diameter_m >= least_m && std::abs(c.lon_deg - 1) < 0.01) all.push_back(c.id);
    }
    std::sort(all.begin(), all.end());
    return all;
  };
  // Craters astride the border reach into both tiles.
  const auto west = ids(craters_reaching({0, 1, 0, 1}, 7, 400), 1500),
             east = ids(craters_reaching({0, 1, 1, 2}, 7, 400), 1500);
  EXPECT_GT(west.size(), 0u);
  EXPECT_EQ(west, east);
  EXPECT_EQ(west, ids(craters_reaching({0, 1, 0, 1}, 7, 1200), 1500));
}

TEST(Craters, OldestFirst) {
  const auto craters = craters_reaching({0, 1, 0, 1}, 7, 1000);
  EXPECT_TRUE(
      std::is_sorted(craters.begin(), craters.end(), [](const Crater& a, const Crater& b) { return a.age > b.age; }));
}

}  // namespace
}  // namespace selenograph::dem
