// Ground below 0.25 m: clods, fragments of rocks, the relief of short wavelengths and small craters, against their
// laws.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <type_traits>
#include <vector>

#include "dem/detail/clod_field.h"
#include "dem/detail/crater_field.h"
#include "dem/detail/detail.h"
#include "dem/detail/fragment_field.h"
#include "dem/detail/relief.h"

namespace selenograph::dem {
namespace {

constexpr double kLat = 0.44, kLon = 0.08;  // radians

// Heights and factors of the albedo of one octave on a square at a place, and which positions are on a clod or
// fragment.
struct Square {
  std::vector<double> heights_m, factor;
  std::vector<float> on_one;
};
template <typename Field>
Square square_of(const Field& field, int octave, std::size_t side, double spacing_m, double lat, double lon) {
  const double step = spacing_m / kMoonRadius_m;
  Square square{std::vector<double>(side * side), std::vector<double>(side * side, 1.0),
                std::vector<float>(side * side)};
  const SquareGrid grid(lat, step, lon, step / std::cos(lat), side);
  if constexpr (std::is_same_v<Field, ClodField>)
    field.add(grid.grid(), octave, {}, square.heights_m, square.on_one, {});
  else
    field.add(grid.grid(), octave, {}, square.heights_m, {square.on_one, square.factor}, {});
  return square;
}

// A post has the same bits from every grid that contains it, also beside a pole and the date line.
template <typename Field>
void expect_the_same_from_every_grid(const Field& field, int octave, double spacing_m) {
  for (const double lat : {0.0, 1.2, std::numbers::pi / 2 - 1e-6})
    for (const double lon : {0.08, std::numbers::pi - 5e-8}) {
      constexpr std::size_t kSide = 60, kPart = 24;
      const double step = spacing_m / kMoonRadius_m;
      const SquareGrid whole(lat, step, lon, step / std::cos(lat), kSide);
      std::vector<double> all(kSide * kSide), part(kPart * kPart);
      field.add(whole.grid(), octave, {}, all, {}, {});
      constexpr std::size_t kRow = 11, kColumn = 17;
      field.add(sub_grid(whole.grid(), kRow, kPart, kColumn, kPart), octave, {}, part, {}, {});
      for (std::size_t r = 0; r < kPart; ++r)
        for (std::size_t c = 0; c < kPart; ++c)
          ASSERT_EQ(part[r * kPart + c], all[(r + kRow) * kSide + c + kColumn]) << lat << ' ' << lon;
    }
}

Region one_degree() { return Region({{25, 4, 0}, {25, 5, 0}, {26, 5, 0}, {26, 4, 0}}); }

template <typename Field>
void expect_within_one_degree(const Field& field) {
  const auto covered = [&](double lat_deg) {
    const Square square = square_of(field, -5, 256, 0.01, lat_deg * kRadiansPerDegree, 4.5 * kRadiansPerDegree);
    return std::count(square.on_one.begin(), square.on_one.end(), 1.F);
  };
  EXPECT_EQ(covered(24), 0);
  EXPECT_GT(covered(25.5), 0);
}

// Patches are metres wide, so that the cover is measured on many squares far apart.
TEST(Clods, CoverTheirShareOfGroundAndKeepItsMeanHeight) {
  const ClodField field({.seed = 3, .cover = 0.1, .largest_m = 0.0625, .smallest_m = 0.00390625});
  EXPECT_EQ(field.smallest_octave(), -8);
  EXPECT_EQ(field.largest_octave(), -5);
  for (const int octave : {-8, -6, -5}) {
    double covered = 0, sum_m = 0, highest_m = 0;
    std::size_t n = 0;
    for (int i = 0; i < 150; ++i) {
      const Square square = square_of(field, octave, 96, std::ldexp(0.25, octave), kLat + 1e-4 * i, kLon);
      for (const float on : square.on_one) covered += static_cast<double>(on);
      for (const double height_m : square.heights_m) {
        sum_m += height_m;
        highest_m = std::max(highest_m, height_m + field.mean_m(octave));
      }
      n += square.heights_m.size();
    }
    const auto places = static_cast<double>(n);
    EXPECT_NEAR(covered / places, 0.1, 0.02) << octave;
    EXPECT_NEAR(sum_m / places / field.mean_m(octave), 0, 0.25) << octave;
    EXPECT_LT(highest_m, field.max_height_m(octave));
    EXPECT_GT(highest_m, 0.6 * field.max_height_m(octave));
  }
}

TEST(Clods, DoNotDependOnTheGrid) {
  expect_the_same_from_every_grid(ClodField({.seed = 3, .cover = 0.2, .largest_m = 0.0625, .smallest_m = 0.00390625}),
                                  -6, 0.002);
}

TEST(Clods, LieInTheirRegion) {
  expect_within_one_degree(
      ClodField({.seed = 3, .cover = 0.1, .largest_m = 0.0625, .smallest_m = 0.00390625}, one_degree()));
}

RockLaw rocks_with_fragments() {
  RockLaw law{.seed = 3, .frequency = rocks_of_viper(), .largest_m = 8, .smallest_m = 0.05};
  law.smallest_fragment_m = 0.00390625;
  law.albedo_variation = 1;
  return law;
}

// The ground keeps its mean height and its mean albedo. A fragment covers some three quarters of a circle.
TEST(Fragments, KeepTheMeansOfTheGround) {
  const FragmentField field(rocks_with_fragments());
  ASSERT_EQ(field.smallest_octave(), -8);
  ASSERT_EQ(field.largest_octave(), -5);
  for (const int octave : {-8, -6, -5}) {
    double covered = 0, sum_m = 0, sum = 0, highest_m = 0;
    std::size_t n = 0;
    for (int i = 0; i < 100; ++i) {
      const Square square = square_of(field, octave, 256, std::ldexp(0.25, octave), kLat + 1e-3 * i, kLon);
      for (const float on : square.on_one) covered += static_cast<double>(on);
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

TEST(Fragments, DoNotDependOnTheGrid) {
  expect_the_same_from_every_grid(FragmentField(rocks_with_fragments()), -7, 0.004);
}

TEST(Fragments, LieInTheirRegion) { expect_within_one_degree(FragmentField(rocks_with_fragments(), one_degree())); }

TEST(Fragments, AreNoneUnlessThePresetHasThem) {
  RockLaw without = rocks_with_fragments();
  without.smallest_fragment_m = 0;
  EXPECT_TRUE(FragmentField(without).empty());
  DetailPreset preset;
  preset.rocks = without;
  EXPECT_EQ(Detail(preset).finest_level(), 0);
  preset.rocks = rocks_with_fragments();
  const Detail detail(preset);
  EXPECT_EQ(Detail::smallest_octave(detail.finest_level()), -8);
  EXPECT_GT(detail.max_detail_m(8), 0);
  EXPECT_EQ(detail.left_out_m(detail.finest_level(), 8), 0);
}

// The law of short wavelengths: an RMS slope of the octave of 0.125 m, growing toward shorter ones.
TEST(FineRelief, HasTheSlopesOfItsLaw) {
  const Relief relief({.seed = 1,
                       .hurst = 0.99,
                       .deviation_m = 0.37,
                       .baseline_m = 10,
                       .longest_m = 64,
                       .shortest_m = 0.00390625,
                       .fine = {.below_m = 0.25, .hurst = 0.52, .slope = 0.042}});
  const Relief without(
      {.seed = 1, .hurst = 0.99, .deviation_m = 0.37, .baseline_m = 10, .longest_m = 64, .shortest_m = 0.25});
  EXPECT_EQ(relief.smallest_octave(), -8);
  EXPECT_EQ(relief.max_height_m(-2), without.max_height_m(-2));  // longer wavelengths stay as they are
  for (const int octave : {-8, -5, -3}) {
    const double wavelength_m = std::ldexp(1.0, octave), spacing_m = wavelength_m / 64;
    const double step = spacing_m / kMoonRadius_m;
    double squares = 0;
    int n = 0;
    for (int i = 0; i < 40; ++i) {
      constexpr std::size_t kSide = 200;
      const SquareGrid grid(kLat + 1e-3 * i, step, kLon, step / std::cos(kLat + 1e-3 * i), kSide);
      for (std::size_t row = 0; row < kSide; row += 20) {
        std::vector<double> heights_m(kSide);
        relief.add_row(octave, grid.grid(), row, heights_m);
        for (std::size_t c = 1; c < kSide; ++c, ++n)
          squares += std::pow((heights_m[c] - heights_m[c - 1]) / spacing_m, 2);
      }
    }
    EXPECT_NEAR(std::sqrt(squares / n) / (0.042 * std::pow(wavelength_m / 0.125, -0.48)), 1, 0.08) << octave;
  }
}

// Chang'e-4 measured 0.061 for craters of decimetres to metres, of all ages (Wu et al. 2021).
TEST(SmallCraters, AreAsDeepAsMeasured) {
  const CraterField field({.seed = 2, .largest_m = 4, .smallest_m = 0.0625});
  double depths = 0;
  int n = 0;
  for (const int octave : {-3, -1, 0}) {
    const double wide_deg = std::ldexp(400.0, octave) / kMetresPerDegree;
    for (const Crater& crater : field.in_box(octave, {10, 10 + wide_deg, 20, 20 + wide_deg})) {
      depths += crater.depth_m / crater.diameter_m;
      ++n;
    }
  }
  ASSERT_GT(n, 5000);
  EXPECT_NEAR(depths / n, 0.06, 0.005);
}

}  // namespace
}  // namespace selenograph::dem
