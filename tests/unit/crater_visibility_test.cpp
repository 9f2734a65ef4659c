// The roughness that craters are measured by, against the same differences on ground with all octaves at once.
#include "dem/detail/crater_visibility.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "dem/detail/detail.h"
#include "dem/grid/lattice.h"

namespace selenograph::dem {
namespace {

using std::numbers::pi;

constexpr int kPostsLevel = 8;  // 118 m: octaves below 2^8 m are the detail's

DetailPreset craters_and_relief() {
  DetailPreset preset;
  preset.craters.seed = 4;
  preset.craters.smallest_m = 4, preset.craters.largest_m = 80;
  preset.relief.seed = 5;
  preset.relief.deviation_m = 0.3, preset.relief.baseline_m = 10;
  preset.relief.shortest_m = 4, preset.relief.longest_m = 64;
  return preset;
}

// A square of ground with all octaves.
class Square {
 public:
  explicit Square(const Detail& detail) : heights_(static_cast<std::size_t>(kPosts) * kPosts) {
    constexpr double kLat = 0.4, kLon = -2.1;
    const double step = kStep_m / kMoonRadius_m, lon_step = step / std::cos(kLat);
    std::array<std::vector<double>, 4> table;
    for (int i = 0; i < kPosts; ++i) {
      const double lat = kLat + (i - kPosts / 2) * step, lon = kLon + (i - kPosts / 2) * lon_step;
      table[0].push_back(std::sin(lat)), table[1].push_back(std::cos(lat));
      table[2].push_back(std::sin(lon)), table[3].push_back(std::cos(lon));
    }
    detail.add({table[0], table[1], table[2], table[3], kLon - (kPosts / 2) * lon_step, lon_step},
               detail.finest_level(), kPostsLevel, heights_, {});
  }

  // Differences between the mean on a circle and its middle.
  std::vector<double> differences(double diameter_m) const {
    const double radius = diameter_m / 2 / kStep_m;
    const int margin = static_cast<int>(radius) + 1;
    std::vector<double> found;
    for (int r = margin; r < kPosts - margin; r += 5)
      for (int c = margin; c < kPosts - margin; c += 5) {
        double sum = 0;
        for (int i = 0; i < 32; ++i)
          sum += at(r + static_cast<int>(std::lround(radius * std::cos(pi * i / 16))),
                    c + static_cast<int>(std::lround(radius * std::sin(pi * i / 16))));
        found.push_back(sum / 32 - at(r, c));
      }
    return found;
  }

 private:
  static constexpr int kPosts = 1401;
  static constexpr double kStep_m = 2;
  double at(int r, int c) const { return heights_[static_cast<std::size_t>(r) * kPosts + static_cast<std::size_t>(c)]; }
  std::vector<double> heights_;
};

double roughness_m(const CraterRoughness& roughness, double diameter_m) {
  double sum = 0;
  for (int k = roughness.smallest_octave(); k < Detail::past_largest_octave(kPostsLevel); ++k)
    sum += roughness.mean_square_m2(k, diameter_m);
  return std::sqrt(sum);
}

TEST(CraterRoughness, IsThatOfAllOctavesTogether) {
  const Detail detail(craters_and_relief());
  const CraterRoughness roughness(detail);
  const Square square(detail);
  for (const double diameter_m : {16.0, 24.0, 32.0, 48.0, 64.0}) {
    const std::vector<double> found = square.differences(diameter_m);
    double sum = 0;
    for (const double d : found) sum += d * d;
    const double expected_m = std::sqrt(sum / static_cast<double>(found.size()));
    EXPECT_NEAR(roughness_m(roughness, diameter_m) / expected_m, 1, 0.2) << diameter_m;
    // A visibility of 1.6 is one of few places'.
    const auto above = std::count_if(found.begin(), found.end(), [&](double d) { return d > 1.6 * expected_m; });
    const double share = static_cast<double>(above) / static_cast<double>(found.size());
    EXPECT_GT(share, 0.01) << diameter_m;
    EXPECT_LT(share, 0.1) << diameter_m;
  }
}

// Relief alone has a closed form in its law: height differences grow with the Hurst exponent of the distance.
TEST(CraterRoughness, OfReliefGrowsWithItsExponent) {
  DetailPreset preset = craters_and_relief();
  preset.craters = {};
  preset.relief.hurst = 0.8, preset.relief.shortest_m = 1, preset.relief.longest_m = 2048;
  const Detail detail(preset);
  const CraterRoughness roughness(detail);
  const auto all_m = [&](double diameter_m) {
    double sum = 0;
    for (int k = roughness.smallest_octave(); k <= roughness.largest_octave(); ++k)
      sum += roughness.mean_square_m2(k, diameter_m);
    return std::sqrt(sum);
  };
  for (const double diameter_m : {8.0, 16.0, 32.0, 64.0})
    EXPECT_NEAR(std::log2(all_m(2 * diameter_m) / all_m(diameter_m)), 0.8, 0.06) << diameter_m;
  // And with its size.
  preset.relief.deviation_m *= 3;
  const CraterRoughness larger{Detail(preset)};
  for (int k = roughness.smallest_octave(); k <= roughness.largest_octave(); ++k)
    EXPECT_NEAR(larger.mean_square_m2(k, 20), 9 * roughness.mean_square_m2(k, 20), 1e-9 * larger.mean_square_m2(k, 20));
}

}  // namespace
}  // namespace selenograph::dem
