// Fragments: rocks that are part of the heights, against the law of the rocks.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "dem/detail/detail.h"
#include "dem/detail/fragment_field.h"

namespace selenograph::dem {
namespace {

constexpr double kLat = 0.44, kLon = 0.08;  // radians

RockLaw law() {
  RockLaw law{.seed = 3, .frequency = rocks_of_viper(), .largest_m = 8, .smallest_m = 0.05};
  law.smallest_fragment_m = 0.00390625;
  law.albedo_variation = 1;
  return law;
}

// Heights and factors of the albedo of one octave on a square at a place, and which positions are on a fragment.
struct Square {
  std::vector<double> heights_m, factor;
  std::vector<float> on_fragment;
};
Square square_of(const FragmentField& field, int octave, std::size_t side, double spacing_m, double lat, double lon) {
  const double step = spacing_m / kMoonRadius_m;
  Square square{std::vector<double>(side * side), std::vector<double>(side * side, 1.0),
                std::vector<float>(side * side)};
  const SquareGrid grid(lat, step, lon, step / std::cos(lat), side);
  field.add(grid.grid(), octave, {}, square.heights_m, {square.on_fragment, square.factor}, {});
  return square;
}

// The ground keeps its mean height and its mean albedo. A fragment covers some three quarters of a circle.
TEST(Fragments, KeepTheMeansOfTheGround) {
  const FragmentField field(law());
  ASSERT_EQ(field.smallest_octave(), -8);
  ASSERT_EQ(field.largest_octave(), -5);
  for (const int octave : {-8, -6, -5}) {
    double covered = 0, sum_m = 0, sum = 0, highest_m = 0;
    std::size_t n = 0;
    for (int i = 0; i < 100; ++i) {
      const Square square = square_of(field, octave, 256, std::ldexp(0.25, octave), kLat + 1e-3 * i, kLon);
      for (const float on : square.on_fragment) covered += static_cast<double>(on);
      for (const double height_m : square.heights_m) {
        sum_m += height_m;
        highest_m = std::max(highest_m, height_m + field.mean_m(octave));
      }
      for (const double factor : square.factor) sum += factor - 1;
      n += square.heights_m.size();
    }
    const auto places = static_cast<double>(n);
    const double smallest_m = std::ldexp(1.0, octave), largest_m = std::min(0.05, 2 * smallest_m);
    const double circles =
        rocks_of_viper().between(smallest_m, largest_m) * std::numbers::pi / 4 * smallest_m * largest_m;
    EXPECT_NEAR(covered / places / circles, 0.7, 0.2) << octave;
    EXPECT_NEAR(sum_m / places / field.mean_m(octave), 0, 0.1) << octave;
    EXPECT_NEAR(sum / places, 0, 0.2 * covered / places * kBrighter) << octave;
    EXPECT_LE(highest_m, field.max_height_m(octave));
    EXPECT_GT(highest_m, 0.6 * field.max_height_m(octave));
  }
}

// A post has the same bits from every grid that contains it, also beside a pole and the date line.
TEST(Fragments, DoNotDependOnTheGrid) {
  const FragmentField field(law());
  for (const double lat : {0.0, 1.2, std::numbers::pi / 2 - 1e-6})
    for (const double lon : {0.08, std::numbers::pi - 5e-8}) {
      constexpr std::size_t kSide = 60, kPart = 24;
      constexpr double kSpacing_m = 0.004;
      const double step = kSpacing_m / kMoonRadius_m;
      const SquareGrid whole(lat, step, lon, step / std::cos(lat), kSide);
      std::vector<double> all(kSide * kSide), part(kPart * kPart);
      field.add(whole.grid(), -7, {}, all, {}, {});
      constexpr std::size_t kRow = 11, kColumn = 17;
      field.add(sub_grid(whole.grid(), kRow, kPart, kColumn, kPart), -7, {}, part, {}, {});
      for (std::size_t r = 0; r < kPart; ++r)
        for (std::size_t c = 0; c < kPart; ++c)
          ASSERT_EQ(part[r * kPart + c], all[(r + kRow) * kSide + c + kColumn]) << lat << ' ' << lon;
    }
}

TEST(Fragments, LieInTheirRegion) {
  const Region region({{25, 4, 0}, {25, 5, 0}, {26, 5, 0}, {26, 4, 0}});
  const FragmentField field(law(), region);
  const auto covered = [&](double lat_deg) {
    const Square square = square_of(field, -5, 256, 0.01, lat_deg * kRadiansPerDegree, 4.5 * kRadiansPerDegree);
    return std::count(square.on_fragment.begin(), square.on_fragment.end(), 1.F);
  };
  EXPECT_EQ(covered(24), 0);
  EXPECT_GT(covered(25.5), 0);
}

TEST(Fragments, AreNoneUnlessThePresetHasThem) {
  RockLaw without = law();
  without.smallest_fragment_m = 0;
  EXPECT_TRUE(FragmentField(without).empty());
  DetailPreset preset;
  preset.rocks = without;
  EXPECT_EQ(Detail(preset).finest_level(), 0);
  preset.rocks = law();
  const Detail detail(preset);
  EXPECT_EQ(Detail::smallest_octave(detail.finest_level()), -8);
  EXPECT_GT(detail.max_detail_m(8), 0);
  EXPECT_EQ(detail.left_out_m(detail.finest_level(), 8), 0);
}

}  // namespace
}  // namespace selenograph::dem
