// The lattice covers the globe exactly once at every level, and the same place has the same tick at every level.
// Coordinates have the same last bits on every system.
#include "dem/grid/lattice.h"

#include <gtest/gtest.h>

#include <GeographicLib/Geocentric.hpp>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <set>

#include "dem/grid/degrees.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {
namespace {

std::int64_t area(const BlockExtent& e) { return static_cast<std::int64_t>(e.lat1() - e.lat0) * (e.lon1() - e.lon0); }

// All rows of coarse levels; of fine ones those at the poles, the equator and around it at random.
std::vector<int> rows_to_try(int level) {
  const int rows = rows_of(level);
  std::set<int> some;
  std::mt19937_64 random(static_cast<unsigned>(level));
  for (int i = 0; i < std::min(rows, 600); ++i)
    some.insert(i), some.insert(rows - 1 - i), some.insert(static_cast<int>(random() % static_cast<unsigned>(rows)));
  return {some.begin(), some.end()};
}

std::vector<int> columns_to_try(int level, int row) {
  const int n = columns_of(level, row);
  return {0, 1 % n, n / 3, n / 2, n - 1};
}

TEST(Lattice, RowsAndColumnsCoverTheGlobeExactly) {
  for (int level = 0; level <= kMaxLevel; ++level) {
    EXPECT_EQ(extent_of({level, rows_of(level) - 1, 0}).lat1(), kLatTicks) << level;
    for (const int row : rows_to_try(level)) {
      const BlockExtent last = extent_of({level, row, columns_of(level, row) - 1});
      ASSERT_EQ(last.lon1(), kLonTicks) << level << ' ' << row;
      if (row > 0) {
        ASSERT_EQ(extent_of({level, row - 1, 0}).lat1(), last.lat0);
      }
    }
  }
}

TEST(Lattice, ChildrenTileTheirParent) {
  for (int level = 0; level < kMaxLevel; ++level)
    for (const int row : rows_to_try(level))
      for (const int col : columns_to_try(level, row)) {
        const BlockId parent{level, row, col};
        const BlockExtent p = extent_of(parent);
        std::int64_t sum = 0;
        BlockId before{-1, 0, 0};
        for (const BlockId& child : children_of(parent)) {
          const BlockExtent c = extent_of(child);
          ASSERT_TRUE(c.lat0 >= p.lat0 && c.lat1() <= p.lat1() && c.lon0 >= p.lon0 && c.lon1() <= p.lon1())
              << to_string(child);
          ASSERT_LT(before, child);  // distinct blocks of one level can't overlap
          ASSERT_EQ(ancestor_of(child, parent.level), parent);
          before = child;
          sum += area(c);
        }
        ASSERT_EQ(sum, area(p)) << to_string(parent);
      }
}

TEST(Lattice, AncestorsAreParentsOfParents) {
  std::mt19937_64 random(7);
  for (int i = 0; i < 2000; ++i) {
    const BlockId leaf = block_at(kMaxLevel, static_cast<Tick>(random() % (kLatTicks + 1UL)),
                                  static_cast<Tick>(random() % static_cast<std::uint64_t>(kLonTicks)));
    BlockId id = leaf;
    while (id.level > 0) {
      const BlockId parent = ancestor_of(id, id.level - 1);
      ASSERT_EQ(ancestor_of(leaf, parent.level), parent);
      const auto children = children_of(parent);
      ASSERT_NE(std::find(children.begin(), children.end(), id), children.end()) << to_string(id);
      id = parent;
    }
    EXPECT_EQ(ancestor_of(leaf, kMaxLevel), leaf);
  }
}

TEST(Lattice, LongitudeStepsDoubleAtMostOncePerRowAndLevel) {
  for (int level = 0; level <= kMaxLevel; ++level) {
    const int rows = rows_of(level);
    for (const int row : rows_to_try(level)) {
      const int shift = lon_shift(level, row);
      EXPECT_EQ(shift, lon_shift(level, rows - 1 - row)) << "north and south differ";
      const bool north = row > rows / 2;
      if (const int poleward = row + (north ? 1 : -1); poleward >= 0 && poleward < rows) {
        const int step = lon_shift(level, poleward) - shift;
        ASSERT_TRUE(row == rows / 2 || step == 0 || step == 1) << level << ' ' << row;
      }
      for (const BlockId& child : children_of({level, row, 0})) {
        const int step = lon_shift(child.level, child.row) - shift;
        ASSERT_TRUE(step == 0 || step == 1) << level << ' ' << row;
      }
    }
  }
}

TEST(Lattice, QuadsStayRoughlySquareUntilABlockIsEightDegreesWide) {
  for (int level = 0; level <= kMaxLevel; ++level)
    for (const int row : rows_to_try(level)) {
      const BlockExtent e = extent_of({level, row, 0});
      const double nearest = std::min(std::abs(lat_deg_of(e.lat0)), std::abs(lat_deg_of(e.lat1())));
      const double aspect = std::cos(nearest * std::numbers::pi / 180) * e.lon_step / e.lat_step;
      ASSERT_LE(aspect, 1.0 + 1e-12);
      ASSERT_LE(e.lon1() - e.lon0, 8 * kTicksPerDegree);
      if (e.lon1() - e.lon0 < 8 * kTicksPerDegree) {
        ASSERT_GT(aspect, 0.25) << level << ' ' << row;
      }
      if (nearest < 75.5) {
        ASSERT_EQ(e.lon_step, e.lat_step);
      }
    }
}

TEST(Lattice, PostsOfTwoPowerProductsAreVertices) {
  // A Kaguya tile's posts (4096 px/deg) are vertices of level 12: the tick is a whole number, and the degree comes
  // back.
  for (int k = -90 * 4096; k <= 90 * 4096; k += 37) {
    const double lat = k / 4096.0;
    const std::int64_t tick = std::llround((lat + 90) * kTicksPerDegree);
    ASSERT_EQ(lat_deg_of(static_cast<Tick>(tick)), lat);
    ASSERT_EQ(tick % extent_of({12, 0, 0}).lat_step, 0);
  }
  EXPECT_EQ(extent_of({12, rows_of(12) / 2, 0}).lon_step, kTicksPerDegree / 4096);
}

TEST(Lattice, BlockAtHoldsItsPlace) {
  std::mt19937_64 random(11);
  for (int level = 0; level <= kMaxLevel; ++level)
    for (int i = 0; i < 500; ++i) {
      const auto lat = static_cast<Tick>(random() % static_cast<std::uint64_t>(kLatTicks)),
                 lon = static_cast<Tick>(random() % static_cast<std::uint64_t>(kLonTicks));
      const BlockExtent e = extent_of(block_at(level, lat, lon));
      ASSERT_TRUE(lat >= e.lat0 && lat < e.lat1() && lon >= e.lon0 && lon < e.lon1());
    }
  for (int level = 0; level <= kMaxLevel; ++level) {
    EXPECT_EQ(block_at(level, kLatTicks, 5).row, rows_of(level) - 1);
    EXPECT_EQ(block_at(level, 0, kLonTicks - 1).row, 0);
    EXPECT_EQ(block_at(level, 0, kLonTicks - 1).col, columns_of(level, 0) - 1);
  }
}

TEST(Lattice, LongitudesWrap) {
  EXPECT_EQ(wrap_lon(0), 0);
  EXPECT_EQ(wrap_lon(-1), kLonTicks - 1);
  EXPECT_EQ(wrap_lon(kLonTicks), 0);
  EXPECT_EQ(wrap_lon(3LL * kLonTicks + 5), 5);
  EXPECT_EQ(wrap_lon(-3LL * kLonTicks - 5), kLonTicks - 5);
  EXPECT_EQ(lon_deg_of(0), -180);
  EXPECT_EQ(lon_deg_of(kLonTicks / 2), 0);
}

TEST(Lattice, SpacingAndSag) {
  // 4096 px/deg is 7.403 m on the 1737.4 km sphere.
  EXPECT_NEAR(post_spacing_m(12), 2 * std::numbers::pi * 1737400 / 360 / 4096, 1e-9);
  // Against the sphere itself: how far the middle of a quad's diagonal lies below it.
  for (int level = 0; level <= 12; ++level) {
    const double half = std::numbers::pi / 180 / std::ldexp(1.0, level) / std::numbers::sqrt2;
    EXPECT_NEAR(chord_sag_m(level) / (kMoonRadius_m * 2 * std::pow(std::sin(half / 2), 2)), 1, 1e-3) << level;
  }
}

TEST(Lattice, HashesDiffer) {
  std::set<std::size_t> seen;
  std::size_t count = 0;
  for (int level = 0; level <= 6; ++level)
    for (int row = 0; row < rows_of(level); ++row)
      for (int col = 0; col < columns_of(level, row); ++col) seen.insert(BlockIdHash()({level, row, col})), ++count;
  EXPECT_EQ(seen.size(), count);
}

TEST(Degrees, MultiplesOf90DegreesAreExact) {
  for (int quarters = -8; quarters <= 8; ++quarters) {
    const auto [sine, cosine] = sine_cosine_of_deg(90.0 * quarters);
    const int turn = quarters & 3;
    EXPECT_EQ(sine, turn == 1 ? 1 : turn == 3 ? -1 : 0) << quarters;
    EXPECT_EQ(cosine, turn == 0 ? 1 : turn == 2 ? -1 : 0) << quarters;
    EXPECT_FALSE(cosine == 0 && std::signbit(cosine)) << quarters;
  }
}

// Other versions of a library round sines of 30 and 45 degrees differently. Posts of DEM tiles are there.
TEST(Degrees, SinesHaveTheirLastBits) {
  EXPECT_EQ(sine_cosine_of_deg(30).sine, 0x1.fffffffffffffp-2);
  EXPECT_EQ(sine_cosine_of_deg(45).sine, 0x1.6a09e667f3bccp-1);
  EXPECT_EQ(sine_cosine_of_deg(45).cosine, 0x1.6a09e667f3bcdp-1);
  EXPECT_EQ(sine_cosine_of_deg(-150).cosine, -0x1.bb67ae8584cabp-1);
  for (double angle_deg = -400; angle_deg <= 400; angle_deg += 0.37) {
    const long double angle = static_cast<long double>(angle_deg) * std::numbers::pi_v<long double> / 180;
    EXPECT_NEAR(sine_cosine_of_deg(angle_deg).sine, static_cast<double>(std::sin(angle)), 0x1p-53) << angle_deg;
    EXPECT_NEAR(sine_cosine_of_deg(angle_deg).cosine, static_cast<double>(std::cos(angle)), 0x1p-53) << angle_deg;
  }
}

TEST(Geodesy, ThereAndBack) {
  for (double lat_deg = -90; lat_deg <= 90; lat_deg += 7.5)
    for (double lon_deg = -180; lon_deg < 180; lon_deg += 7.5)
      for (const double height_m : {-9000.0, 0.0, 1e5, 4e8}) {
        const Geographic back = to_geographic(to_cartesian({lat_deg, lon_deg, height_m}));
        EXPECT_NEAR(back.lat_deg, lat_deg, 2e-14);
        EXPECT_NEAR(back.lon_deg, std::abs(lat_deg) == 90 ? 0 : lon_deg, 6e-14);
        EXPECT_NEAR(back.height_m, height_m, 1e-15 * (kMoonRadius_m + height_m));
      }
  EXPECT_TRUE(to_cartesian({90.1, 0, 0}).has_nan());
}

// Whatever its version: last bits are not compared.
TEST(Geodesy, AgreesWithGeographicLib) {
  const GeographicLib::Geocentric sphere(kMoonRadius_m, 0);
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> lat(-90, 90), lon(-360, 360), height(-9000, 1e5);
  for (int i = 0; i < 10000; ++i) {
    const Geographic place{lat(random), lon(random), height(random)};
    Vec3 expected_m;
    sphere.Forward(place.lat_deg, place.lon_deg, place.height_m, expected_m.x(), expected_m.y(), expected_m.z());
    ASSERT_LT((to_cartesian(place) - expected_m).norm(), 2e-9) << place.lat_deg << ' ' << place.lon_deg;
    Geographic expected;
    sphere.Reverse(expected_m.x(), expected_m.y(), expected_m.z(), expected.lat_deg, expected.lon_deg,
                   expected.height_m);
    const Geographic back = to_geographic(expected_m);
    ASSERT_NEAR(back.lat_deg, expected.lat_deg, 1e-13);
    ASSERT_NEAR(std::remainder(back.lon_deg - expected.lon_deg, 360), 0, 1e-13);
    ASSERT_NEAR(back.height_m, expected.height_m, 2e-9);
  }
}

TEST(Geodesy, LongitudesWrap) {
  for (const double lon_deg : {180.0, -180.0, 540.0, -540.0}) EXPECT_EQ(wrap_lon_deg(lon_deg), -180) << lon_deg;
  EXPECT_EQ(wrap_lon_deg(359.5), -0.5);
  EXPECT_EQ(wrap_lon_deg(-180.5), 179.5);
  EXPECT_EQ(to_geographic({-1, 0, 0}).lon_deg, -180);
  EXPECT_EQ(to_geographic({0, -1, 0}).lon_deg, -90);
}

}  // namespace
}  // namespace selenograph::dem
