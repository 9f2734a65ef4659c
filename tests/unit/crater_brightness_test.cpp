// Brightness of young craters (dem/detail/crater_brightness.h).
#include "dem/detail/crater_brightness.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "dem/detail/detail.h"

namespace selenograph::dem {
namespace {

constexpr double kRadiansPerMetre = 1 / kMoonRadius_m;

// Returns the factors of one octave on a square of `side` positions `step_m` apart, beside the equator.
std::vector<double> factors(const CraterBrightness& brightness, const CraterField& field, int octave, double step_m,
                            std::size_t side, double south_m = 0, double west_m = 0) {
  const double step = step_m * kRadiansPerMetre;
  const SquareGrid square(south_m * kRadiansPerMetre, step, 1 + west_m * kRadiansPerMetre, step, side);
  std::vector<double> out(side * side, 1.0);
  brightness.add(field, square.grid(), octave, {}, out, {});
  return out;
}

double mean_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

CraterLaw craters(double smallest_m, double largest_m, std::uint64_t seed = 5) {
  return {.seed = seed, .largest_m = largest_m, .smallest_m = smallest_m};
}

// A map's albedo must stay the mean over the ground: exactly what the craters add is subtracted. The scatter between
// squares of a million positions is 0.0004.
TEST(CraterBrightness, ItsMeanIsOne) {
  for (const int octave : {-1, 3, 5, 8}) {
    const double smallest_m = std::ldexp(1.0, octave);
    double sum = 0;
    constexpr int kSeeds = 4;
    for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
      const CraterField field(craters(smallest_m, 2 * smallest_m, seed));
      const CraterBrightness brightness(field, 1);
      EXPECT_GT(brightness.mean(octave), 0.001) << "else the test could not fail";
      sum += mean_of(factors(brightness, field, octave, smallest_m, 1000));
    }
    EXPECT_NEAR(sum / kSeeds, 1, 0.0007) << "octave " << octave;
  }
}

// New craters that dig below the mature soil add 0.7 at the rim, times 0.2 to 1.2, less a sixteenth of the dimming;
// those of decimetres a fifth of that. They fade in 6 Ma at 10 m.
TEST(CraterBrightness, YoungCratersAreBrightAndFade) {
  const CraterField field(craters(0.25, 64));
  const CraterBrightness brightness(field, 1);
  double darkest = 1, brightest = 0;
  for (std::uint64_t id = 1; id < 2000; ++id) {
    Crater crater{Vec3::unit_x(), 40, 5, 0, 0, 0, id * 0x9E3779B97F4A7C15U, {}};  // without height, hence walls
    const double fresh = brightness.at_rim(crater);
    darkest = std::min(darkest, fresh);
    brightest = std::max(brightest, fresh);
    crater.age_Ma = 6 * std::pow(4, 1.05);
    EXPECT_NEAR(brightness.at_rim(crater), fresh * (0.85 * std::exp(-1) + 0.15 * std::exp(-0.2)), 0.02 * fresh + 0.01);
    crater.age_Ma = 3000;
    EXPECT_EQ(brightness.at_rim(crater), 0);
    crater.age_Ma = 0;
    crater.diameter_m = 0.3;
    EXPECT_NEAR(brightness.at_rim(crater), fresh / 5, 0.03 * fresh);
  }
  EXPECT_NEAR(darkest, 0.2 * 0.7, 0.01);
  EXPECT_NEAR(brightest, 1.2 * 0.7, 0.03);
}

// A crater whose wall is steeper than 30 degrees adds 0.3 there while it is steep; one of 15 degrees adds nothing.
TEST(CraterBrightness, SteepWallsAreBright) {
  const CraterField field(craters(64, 512));
  const CraterBrightness brightness(field, 1);
  const auto at_rim = [&](double depth_over_diameter, double age) {
    const double scale = 200 * depth_over_diameter / CraterShape::kFreshDepth;
    return brightness.at_rim({Vec3::unit_x(), 200, 0, 3000, age, scale, 7, {}});
  };
  EXPECT_NEAR(at_rim(0.27, 0), 0.15, 0.02);  // the rim is the middle of the wall's upper edge
  EXPECT_EQ(at_rim(0.27, 0.1), 0);
  EXPECT_EQ(at_rim(0.11, 0), 0);
}

// Blocks are made one by one: a position has the same factor, to the bit, in each grid that contains it.
TEST(CraterBrightness, APositionHasOneFactor) {
  const CraterField field(craters(4, 64));
  const CraterBrightness brightness(field, 1);
  constexpr std::size_t kSide = 120, kPart = 40;
  for (int octave = 2; octave <= 5; ++octave) {
    const std::vector<double> whole = factors(brightness, field, octave, 4, kSide);
    const double step = 4 * kRadiansPerMetre;
    const SquareGrid square(0, step, 1, step, kSide);
    const DirectionGrid part = sub_grid(square.grid(), 50, kPart, 60, kPart);
    std::vector<double> alone(kPart * kPart, 1.0);
    brightness.add(field, part, octave, {}, alone, {});
    EXPECT_NE(*std::min_element(whole.begin(), whole.end()), *std::max_element(whole.begin(), whole.end()));
    for (std::size_t r = 0; r < kPart; ++r)
      for (std::size_t c = 0; c < kPart; ++c)
        ASSERT_EQ(alone[r * kPart + c], whole[(r + 50) * kSide + c + 60]) << octave << ' ' << r << ' ' << c;
  }
}

TEST(CraterBrightness, WithoutVariationThereIsNone) {
  const CraterField field(craters(4, 64));
  EXPECT_TRUE(CraterBrightness(field, 0).none());
  EXPECT_FALSE(CraterBrightness(field, 0.5).none());
}

// Around bright craters rays alternate: at three radii some azimuths are several times as bright as others.
TEST(CraterBrightness, BrightGroundBreaksIntoRays) {
  const CraterField field(craters(32, 64, 11));
  const CraterBrightness brightness(field, 1);
  const Footprint box{-0.2, 0.2, 57, 57.6};
  std::vector<Crater> young = field.in_box(5, box);
  std::erase_if(young, [&](const Crater& crater) { return brightness.at_rim(crater) < 0.4; });
  ASSERT_GT(young.size(), 3U);
  int with_rays = 0;
  for (const Crater& crater : young) {
    const Geographic centre = to_geographic(crater.centre * kMoonRadius_m);
    std::vector<double> ring;
    for (int i = 0; i < 180; ++i) {
      const double azimuth = 2 * std::numbers::pi * i / 180, away = 2 * crater.diameter_m / 2 * kRadiansPerMetre;
      const double lat = centre.lat_deg * kRadiansPerDegree + away * std::cos(azimuth),
                   lon = centre.lon_deg * kRadiansPerDegree + away * std::sin(azimuth);
      const SquareGrid point(lat, 1e-9, lon, 1e-9, 2);
      std::vector<double> out(4, 1.0);
      brightness.add(field, point.grid(), 5, {}, out, {});
      ring.push_back(out[0]);
    }
    std::sort(ring.begin(), ring.end());
    with_rays += ring[162] - 1 > 2 * (ring[18] - 1);
  }
  EXPECT_GT(with_rays, static_cast<int>(young.size()) / 2);
}

}  // namespace
}  // namespace selenograph::dem
