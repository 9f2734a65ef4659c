// Outlines of craters: waves around a circle that keep its mean radius and the bounds of its heights.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "dem/detail/crater_shape.h"
#include "dem/detail/detail.h"
#include "dem/detail/features.h"

namespace selenograph::dem {
namespace {

using std::numbers::pi;

constexpr double kReach = 1.6;  // of a fresh crater, radii

TEST(CraterOutline, RimsAreUnevenWithAMeanRadiusOfOne) {
  double squares = 0;
  int n = 0;
  for (std::uint64_t id = 1; id <= 400; ++id) {
    const CraterOutline outline(id * 0x9E3779B97F4A7C15U, 2, 0.001);
    double sum = 0;
    constexpr int kAround = 64;
    for (int i = 0; i < kAround; ++i) {
      const double azimuth = 2 * pi * i / kAround, east = std::cos(azimuth), north = std::sin(azimuth);
      const double rim = outline.rim(east, north, kReach);
      EXPECT_NEAR(outline.round(rim, east, north, kReach), 1, 1e-6);
      EXPECT_LT(std::abs(outline.wave(static_cast<float>(east), static_cast<float>(north))), CraterOutline::kMaxWave);
      sum += rim;
      squares += (rim - 1) * (rim - 1);
      ++n;
    }
    EXPECT_NEAR(sum / kAround, 1, 0.015);
  }
  EXPECT_NEAR(std::sqrt(squares / n), 0.05, 0.01);
}

// Diffusion smooths waves of n periods as exp(-n^2 kappa t / R^2); larger craters are rounder; the reach stays.
TEST(CraterOutline, OldAndLargeCratersAreRounder) {
  const auto deviation = [](double diameter_m, double age) {
    double squares = 0;
    for (std::uint64_t id = 1; id <= 200; ++id)
      for (int i = 0; i < 16; ++i) {
        const CraterOutline outline(id * 0x9E3779B97F4A7C15U, diameter_m, age);
        squares += std::pow(
            outline.wave(static_cast<float>(std::cos(pi * i / 8)), static_cast<float>(std::sin(pi * i / 8))), 2);
      }
    return std::sqrt(squares / 3200);
  };
  EXPECT_LT(deviation(2, 0.1), 0.75 * deviation(2, 0));
  EXPECT_NEAR(deviation(96, 0) / deviation(2, 0), 0.5, 0.01);
  const CraterOutline outline(7, 2, 0);
  EXPECT_EQ(outline.round(kReach, 0.6, 0.8, kReach), kReach);
  double before = 0;
  for (double r = 0.01; r <= kReach; r += 0.01) {
    const double round = outline.round(r, -0.6, 0.8, kReach);
    EXPECT_GT(round, before) << r;
    before = round;
  }
}

// Heights follow the outline: on the rim that features name a fresh crater is equally high all around, on a circle it
// is not.
TEST(CraterOutline, HeightsAreThoseOfTheRimThatFeaturesName) {
  DetailPreset preset;
  preset.craters = {.seed = 9, .largest_m = 16, .smallest_m = 8};
  const Detail detail(preset);
  // Returns the spread of heights around a crater's rim, over its depth, without the lowest and the highest points.
  const auto spread = [&](const Crater& crater) {
    constexpr int kAround = 24, kCut = 3;
    std::vector<double> heights_m;
    for (int i = 0; i < kAround; ++i) {
      const Geographic at = to_geographic(CraterSurvey::on_rim(crater, 2 * pi * i / kAround) * kMoonRadius_m);
      const SquareGrid point(at.lat_deg * kRadiansPerDegree, 1e-9, at.lon_deg * kRadiansPerDegree, 1e-9, 2);
      std::vector<double> height_m(4);
      detail.add_octave(point.grid(), 3, height_m);
      heights_m.push_back(height_m[0]);
    }
    std::sort(heights_m.begin(), heights_m.end());
    return (heights_m[kAround - 1 - kCut] - heights_m[kCut]) / crater.depth_m;
  };
  int fresh = 0, level = 0;
  double on_rim = 0, on_circle = 0;
  for (const Crater& crater : detail.craters().in_box(3, {10, 10.3, 20, 20.3})) {
    if (crater.age > 0.003) continue;
    ++fresh;
    const double rim_spread = spread(crater);
    if (rim_spread > 0.03) continue;  // younger craters of the octave cover the rim
    ++level;
    Crater circle = crater;
    circle.outline = {};
    on_rim += rim_spread;
    on_circle += spread(circle);
  }
  EXPECT_GT(fresh, 40);
  EXPECT_GT(level, fresh / 3);
  EXPECT_GT(on_circle, 3 * on_rim);
}

}  // namespace
}  // namespace selenograph::dem
