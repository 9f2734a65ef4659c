#include "engine/verify/difference_statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

namespace selenograph::engine {
namespace {

constexpr float kVoid = std::numeric_limits<float>::quiet_NaN();

// At the equator, where a post's spacing is the same both ways.
RoundTrip trip_of(
    int width, int height, const std::function<float(int, int)>& difference,
    const std::function<float(int, int)>& original = [](int, int) { return 0.F; }) {
  RoundTrip trip;
  PostWindow& w = trip.window;
  w.tile.width = width, w.tile.height = height;
  dem::set_grid(w.tile, dem::GeographicGrid{(height - 1) / 1024.0, 10, 1024, 1024});
  w.width = width, w.height = height;
  for (int r = 0; r < height; ++r)
    for (int c = 0; c < width; ++c) {
      trip.original_m.push_back(original(r, c));
      trip.difference_m.push_back(difference(r, c));
      trip.compared += !std::isnan(trip.difference_m.back());
    }
  return trip;
}

TEST(DifferenceStatistics, KnownNumbers) {
  // -3, 1, 2, 4 and a void.
  const float values[] = {-3, 1, 2, 4, kVoid};
  const DifferenceStatistics s = statistics_of(trip_of(5, 1, [&](int, int c) { return values[c]; }));
  EXPECT_EQ(s.all.posts, 4u);
  EXPECT_DOUBLE_EQ(s.all.mean_m, 1);
  EXPECT_DOUBLE_EQ(s.all.mean_absolute_m, 2.5);
  EXPECT_DOUBLE_EQ(s.all.rms_m, std::sqrt(30.0 / 4));
  EXPECT_DOUBLE_EQ(s.standard_deviation_m, std::sqrt(26.0 / 3));
  EXPECT_DOUBLE_EQ(s.median_m, 1.5);
  EXPECT_DOUBLE_EQ(s.median_absolute_m, 2.5);
  EXPECT_DOUBLE_EQ(s.worst_m, 4);
  EXPECT_EQ(s.worst_col, 3);
  // NumPy: np.percentile([-3, 1, 2, 4], [0.1, 95]).
  EXPECT_NEAR(s.percentiles.front().value_m, -2.988, 1e-12);
  EXPECT_NEAR(s.percentiles[4].value_m, 3.7, 1e-12);
}

TEST(DifferenceStatistics, HistogramIsCentredOnZero) {
  // 1000 values: the 99.5th percentile of their size is 0.1999, rounded up to 0.2; one lies beyond on each side.
  const DifferenceStatistics s = statistics_of(trip_of(1000, 1, [](int, int c) {
    if (c < 2) return c == 0 ? -9.F : 9.F;
    if (c < 300) return -0.14F;
    return c < 500 ? 0.F : 0.1999F;
  }));
  const Histogram& h = s.histogram;
  EXPECT_EQ(h.reach_m, 0.2);
  EXPECT_EQ(h.below, 1u);
  EXPECT_EQ(h.above, 1u);
  EXPECT_EQ(h.counts[30], 200u) << "zero is in the middle class";
  EXPECT_EQ(h.counts[60], 500u);
  EXPECT_EQ(h.counts[9], 298u) << "(-0.14 + 0.2) / 0.4 x 61 = 9.15";
}

TEST(DifferenceStatistics, EmptyHistogram) {
  const DifferenceStatistics s = statistics_of(trip_of(3, 1, [](int, int) { return kVoid; }));
  EXPECT_GT(s.histogram.reach_m, 0);
  EXPECT_EQ(s.histogram.below + s.histogram.above + s.histogram.counts[30], 0u);
}

TEST(DifferenceStatistics, WorstIsLargestInSize) {
  const DifferenceStatistics s =
      statistics_of(trip_of(8, 8, [](int r, int c) { return r == 5 && c == 2 ? -9.F : 8.F; }));
  EXPECT_DOUBLE_EQ(s.worst_m, -9);
  EXPECT_EQ(s.worst_row, 5);
  EXPECT_EQ(s.worst_col, 2);
}

TEST(DifferenceStatistics, QuadrantsAreWhereTheirNamesSay) {
  const DifferenceStatistics s = statistics_of(
      trip_of(64, 64, [](int r, int c) { return static_cast<float>((r < 32 ? 10 : 20) + (c < 32 ? 1 : 2)); }));
  for (const Quadrant& q : s.quadrants) {
    const double expected = (q.name[0] == 'N' ? 10 : 20) + (q.name[1] == 'W' ? 1 : 2);
    EXPECT_DOUBLE_EQ(q.statistics.mean_m, expected) << q.name;
    EXPECT_EQ(q.statistics.posts, 1024u);
    EXPECT_TRUE(std::isnan(q.statistics.z)) << "one square has no scatter";
  }
}

// Squares of 32 x 32 with means of +1 and -1, and one pair of +3 and -1: computed by hand.
TEST(DifferenceStatistics, StandardErrorComesFromSquares) {
  const DifferenceStatistics s = statistics_of(trip_of(128, 32, [](int, int c) {
    const float mean[] = {1, -1, 3, -1};
    return mean[c / 32];
  }));
  EXPECT_DOUBLE_EQ(s.all.mean_m, 0.5);
  // Sample variance of the four means: 11 / 3.
  EXPECT_NEAR(s.all.standard_error_m, std::sqrt(11.0 / 3 / 4), 1e-12);
  EXPECT_NEAR(s.all.z, 0.5 / std::sqrt(11.0 / 12), 1e-12);
}

// Correlated differences have fewer independent ones than posts: the naive standard error would call this a bias of six
// sigma. Uncorrelated ones with a true lean are found out.
TEST(DifferenceStatistics, TiltIsBiasAndWavesAreNot) {
  const auto wave = [](int r, int c) { return static_cast<float>(std::sin(r / 9.0) * std::sin(c / 11.0)); };
  EXPECT_LT(std::abs(statistics_of(trip_of(256, 256, wave)).all.z), 3);
  const auto noise = [](int r, int c) { return static_cast<float>(((r * 7919 + c * 104729) % 1000) / 500.0 - 0.9995); };
  EXPECT_LT(std::abs(statistics_of(trip_of(256, 256, noise)).all.z), 3);
  EXPECT_GT(statistics_of(trip_of(256, 256, [&](int r, int c) { return noise(r, c) + 0.1F; })).all.z, 10);
}

TEST(DifferenceStatistics, RoundingIsNotBias) {
  const DifferenceStatistics s = statistics_of(trip_of(256, 256, [](int, int) { return 1e-11F; }));
  EXPECT_LT(s.all.z, 1);
}

TEST(DifferenceStatistics, SlopesAreTheOriginals) {
  const double spacing_m = kMoonRadius_m * std::acos(-1.0) / 180 / 1024;
  const DifferenceStatistics s = statistics_of(trip_of(
      64, 64, [](int, int c) { return c < 30 ? 1.F : 2.F; },
      // Level, and from column 30 on 32 degrees steep to the east.
      [&](int, int c) {
        return c < 30 ? 0.F : static_cast<float>((c - 29) * spacing_m * std::tan(32 * std::acos(-1.0) / 180));
      }));
  ASSERT_GE(s.slopes.size(), 2u);
  EXPECT_EQ(s.slopes.front().from_deg, 0);
  EXPECT_DOUBLE_EQ(s.slopes.front().statistics.mean_m, 1);
  EXPECT_EQ(s.slopes.back().from_deg, 30);
  EXPECT_EQ(s.slopes.back().to_deg, 35);
  EXPECT_DOUBLE_EQ(s.slopes.back().statistics.mean_m, 2);
}

TEST(DifferenceStatistics, EmptyStatisticsAreNan) {
  const DifferenceStatistics s = statistics_of(trip_of(4, 4, [](int, int) { return kVoid; }));
  EXPECT_EQ(s.all.posts, 0u);
  EXPECT_TRUE(std::isnan(s.all.mean_m));
  EXPECT_TRUE(std::isnan(s.worst_m));
  EXPECT_EQ(s.worst_row, -1);
}

}  // namespace
}  // namespace selenograph::engine
