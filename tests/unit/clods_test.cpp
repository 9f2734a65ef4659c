// Ground below 0.25 m: clods, the relief of short wavelengths and small craters, against their laws.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "dem/detail/clod_field.h"
#include "dem/detail/crater_field.h"
#include "dem/detail/relief.h"

namespace selenograph::dem {
namespace {

constexpr double kLat = 0.44, kLon = 0.08;  // radians

// Heights of one octave of clods on a square at a place, and which of them are on a clod.
struct Square {
  std::vector<double> heights_m;
  std::vector<float> on_clod;
};
Square square_of(const ClodField& field, int octave, std::size_t side, double spacing_m, double lat, double lon) {
  const double step = spacing_m / kMoonRadius_m;
  Square square{std::vector<double>(side * side), std::vector<float>(side * side)};
  field.add(SquareGrid(lat, step, lon, step / std::cos(lat), side).grid(), octave, {}, square.heights_m, square.on_clod,
            {});
  return square;
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
      for (const float on : square.on_clod) covered += static_cast<double>(on);
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

// A post has the same bits from every grid that contains it, also beside a pole and the date line.
TEST(Clods, DoNotDependOnTheGrid) {
  const ClodField field({.seed = 3, .cover = 0.2, .largest_m = 0.0625, .smallest_m = 0.00390625});
  for (const double lat : {0.0, 1.2, std::numbers::pi / 2 - 1e-6})
    for (const double lon : {0.08, std::numbers::pi - 5e-8}) {
      constexpr std::size_t kSide = 40, kPart = 16;
      constexpr double kSpacing_m = 0.002;
      const double step = kSpacing_m / kMoonRadius_m;
      const SquareGrid whole(lat, step, lon, step / std::cos(lat), kSide);
      std::vector<double> all(kSide * kSide), part(kPart * kPart);
      field.add(whole.grid(), -6, {}, all, {}, {});
      constexpr std::size_t kRow = 11, kColumn = 17;
      field.add(sub_grid(whole.grid(), kRow, kPart, kColumn, kPart), -6, {}, part, {}, {});
      for (std::size_t r = 0; r < kPart; ++r)
        for (std::size_t c = 0; c < kPart; ++c)
          ASSERT_EQ(part[r * kPart + c], all[(r + kRow) * kSide + c + kColumn]) << lat << ' ' << lon;
    }
}

TEST(Clods, LieInTheirRegion) {
  const Region region({{25, 4, 0}, {25, 5, 0}, {26, 5, 0}, {26, 4, 0}});
  const ClodField field({.seed = 3, .cover = 0.1, .largest_m = 0.0625, .smallest_m = 0.00390625}, region);
  const auto covered = [&](double lat_deg) {
    const Square square = square_of(field, -5, 96, 0.01, lat_deg * kRadiansPerDegree, 4.5 * kRadiansPerDegree);
    return std::count(square.on_clod.begin(), square.on_clod.end(), 1.F);
  };
  EXPECT_EQ(covered(24), 0);
  EXPECT_GT(covered(25.5), 0);
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
