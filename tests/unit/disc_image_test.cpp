// Images of a spinning scanner: where their lines lie, and how that is found.
#include "engine/verify/disc_image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace selenograph::engine {
namespace {

constexpr int kSize = 48;

DiscImage disc() {
  DiscImage image{kSize, kSize, {}};
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x)
      image.radiance.push_back(static_cast<float>(
          std::hypot(x - 23.5, y - 22.5) < 17 ? 10 + std::sin(0.7 * x) + std::cos(0.5 * y + 0.2 * x) : 0));
  return image;
}

double centroid_px(const DiscImage& image, int row) {
  double sum = 0, weighted = 0;
  for (int x = 0; x < image.width; ++x) {
    const auto light = static_cast<double>(image.radiance[static_cast<std::size_t>(row * image.width + x)]);
    sum += light, weighted += x * light;
  }
  return weighted / sum;
}

// Three lines a turn, from the bottom up; half a pixel at most.
TEST(SpinScan, LinesAreDisplacedTogether) {
  const SpinScan scan{3, 0.455, 1, 0.2};
  std::vector<double> up;
  for (int row = 9; row >= 0; --row) up.push_back(scan.displacement_px(row, 10));
  const std::vector<double> expected{0.2, 0.2, -0.345, -0.345, -0.345, 0.11, 0.11, 0.11, -0.435, -0.435};
  for (std::size_t i = 0; i < up.size(); ++i) EXPECT_NEAR(up[i], expected[i], 1e-12) << i;
  EXPECT_EQ(SpinScan().displacement_px(4, 10), 0);
}

TEST(SpinScan, FramesAreDisplacedAsTheImageIs) {
  const SpinScan scan{3, 0.455, 2, 0.3};
  const DiscImage still = spread(disc(), {0.6}), moved = spread(disc(), {0.6, 0.4, 0, scan});
  for (int row = 8; row < 38; ++row)
    EXPECT_NEAR(centroid_px(moved, row) - centroid_px(still, row), 0.4 + scan.displacement_px(row, kSize), 2e-3) << row;
}

// Four pixels of the frame to one of the image: the light is where it is in a frame of the image's pixels.
TEST(Spread, AveragesFinePixels) {
  DiscImage fine{4 * kSize, 4 * kSize, {}, 4}, coarse{kSize, kSize, {}};
  coarse.radiance.assign(kSize * kSize, 0.F);
  for (int y = 0; y < fine.height; ++y)
    for (int x = 0; x < fine.width; ++x) {
      const float light = std::hypot(x - 90.0, y - 80.0) < 60 ? 2.F : 0.F;
      fine.radiance.push_back(light);
      coarse.radiance[static_cast<std::size_t>(y / 4 * kSize + x / 4)] += light / 16;
    }
  for (const double d_px : {-0.45, 0.0, 0.3}) {
    const Placement by{1, d_px, -d_px, {3, 0.455, 1, 0.2}};
    const DiscImage a = spread(fine, by), b = spread(coarse, by);
    ASSERT_EQ(a.width, kSize);
    ASSERT_EQ(a.radiance.size(), b.radiance.size());
    double light_a = 0, light_b = 0;
    for (std::size_t i = 0; i < a.radiance.size(); ++i) {
      // Coarse pixels average twice, before and after light is spread: by an edge of 2 that is some hundredths.
      EXPECT_NEAR(a.radiance[i], b.radiance[i], 0.06) << i;
      light_a += static_cast<double>(a.radiance[i]), light_b += static_cast<double>(b.radiance[i]);
    }
    EXPECT_NEAR(light_a, light_b, 1e-4 * light_b);
    for (int row = 8; row < 32; ++row) EXPECT_NEAR(centroid_px(a, row), centroid_px(b, row), 3e-3) << row;
  }
}

TEST(SpinScan, IsFoundInTheImageAlone) {
  for (int first = 0; first < 3; ++first)
    for (const double phase_px : {0.1, 0.45, 0.8}) {
      const DiscImage image = spread(disc(), {0.6, 0.2, -0.1, {3, 0.455, first, phase_px}});
      const SpinScan found = scan_of({image}, {3, 0.455});
      EXPECT_EQ(found.first, first) << phase_px;
      EXPECT_NEAR(found.phase_px, phase_px, 0.08) << first;
    }
}

}  // namespace
}  // namespace selenograph::engine
