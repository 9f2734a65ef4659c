// The lens against its polynomial, its derivative and its fold in closed form; a pixel's ray against the lens.
#include "engine/camera/lens.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>

#include "engine/camera/pixel_rays.h"
#include "tests/support/processor_time.h"

namespace selenograph::engine {
namespace {

Distortion strong() {
  Distortion d;
  d.k1 = -0.21, d.k2 = 0.07, d.k3 = -0.01, d.p1 = 0.006, d.p2 = -0.004;
  return d;
}

TEST(LensMap, IsBrownsPolynomial) {
  const Lens lens(strong());
  const double x = 0.3, y = -0.4;  // r^2 = 1/4
  const double radial = 1 - 0.21 / 4 + 0.07 / 16 - 0.01 / 64;
  const Eigen::Vector2d p = lens.distorted(x, y);
  EXPECT_NEAR(p.x(), x * radial + 2 * 0.006 * x * y - 0.004 * (0.25 + 2 * x * x), 1e-15);
  EXPECT_NEAR(p.y(), y * radial + 0.006 * (0.25 + 2 * y * y) - 2 * 0.004 * x * y, 1e-15);
}

TEST(LensMap, WithoutCoefficientsIsTheIdentityEverywhere) {
  const Lens lens{Distortion{}};
  EXPECT_EQ(lens.distorted(3, -7), Eigen::Vector2d(3, -7));
  EXPECT_EQ(lens.jacobian(3, -7), Eigen::Matrix2d(Eigen::Matrix2d::Identity()));
  EXPECT_TRUE(lens.holds(1e6, 1e6));
  EXPECT_TRUE(std::isinf(lens.reach()));
}

TEST(LensMap, JacobianIsItsDerivative) {
  const Lens lens(strong());
  const double h = 1e-6;
  const Eigen::Matrix2d j = lens.jacobian(0.3, -0.4);
  EXPECT_LT((j.col(0) - (lens.distorted(0.3 + h, -0.4) - lens.distorted(0.3 - h, -0.4)) / (2 * h)).norm(), 1e-9);
  EXPECT_LT((j.col(1) - (lens.distorted(0.3, -0.4 + h) - lens.distorted(0.3, -0.4 - h)) / (2 * h)).norm(), 1e-9);
}

// r (1 - k r^2) turns where its derivative 1 - 3 k r^2 is 0, at 2/3 of that radius.
TEST(LensMap, EndsWhereTheRadialPolynomialTurns) {
  Distortion d;
  d.k1 = -0.3;
  const Lens lens(d);
  const double fold = 1 / std::sqrt(3 * 0.3);
  EXPECT_GE(lens.reach(), fold * (1 - 1e-12));
  EXPECT_LT(lens.reach(), fold * 1.01);
  const double cos = std::cos(0.7), sin = std::sin(0.7);
  EXPECT_TRUE(lens.holds(0.999 * fold * cos, 0.999 * fold * sin));
  EXPECT_FALSE(lens.holds(1.001 * fold * cos, 1.001 * fold * sin));
  const auto inside = lens.undistorted(0.999 * 2 / 3 * fold * cos, 0.999 * 2 / 3 * fold * sin);
  ASSERT_TRUE(inside.has_value());
  EXPECT_LT(inside->norm(), fold);
  EXPECT_FALSE(lens.undistorted(1.001 * 2 / 3 * fold * cos, 1.001 * 2 / 3 * fold * sin).has_value());
}

TEST(LensMap, IsInvertedToRounding) {
  const Lens lens(strong());
  for (double x = -0.9; x <= 0.9; x += 0.15)
    for (double y = -0.6; y <= 0.6; y += 0.15) {
      ASSERT_TRUE(lens.holds(x, y));
      const Eigen::Vector2d image = lens.distorted(x, y);
      const auto back = lens.undistorted(image.x(), image.y());
      ASSERT_TRUE(back.has_value()) << x << " " << y;
      EXPECT_LT((*back - Eigen::Vector2d(x, y)).norm(), 1e-13) << x << " " << y;
    }
}

Camera camera(const Distortion& distortion) {
  Camera c;
  c.width = 40, c.height = 30, c.fx = 32, c.fy = 30, c.cx = 19.5, c.cy = 14;
  c.distortion = distortion;
  return c;
}

TEST(PixelRaysTest, TheLensMapsEachBackToItsPixel) {
  const Camera c = camera(strong());
  const Lens lens(c.distortion);
  const PixelRays rays(c, 0.25, -0.125);
  ASSERT_EQ(rays.x.size(), 40U * 30);
  ASSERT_EQ(rays.y.size(), 40U * 30);
  for (int y = 0; y < c.height; ++y)
    for (int x = 0; x < c.width; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * 40 + static_cast<std::size_t>(x);
      const Eigen::Vector2d image = lens.distorted(rays.x[i], rays.y[i]);
      EXPECT_NEAR(c.fx * image.x() + c.cx, x + 0.25, 1e-11);
      EXPECT_NEAR(c.fy * image.y() + c.cy, y - 0.125, 1e-11);
    }
}

TEST(PixelRaysTest, AreEmptyWithoutALens) { EXPECT_TRUE(PixelRays(camera({}), 0, 0).x.empty()); }

TEST(PixelRaysTest, StopAtTheDeadline) {
  Camera wide = camera(strong());
  wide.width = 8192, wide.height = 2048;
  const StopToken soon(StopToken::Clock::now() + std::chrono::milliseconds(50));
  EXPECT_LT(test::processor_s_per_core([&] { EXPECT_THROW(PixelRays(wide, 0, 0, soon), Cancelled); }), 0.05 + 0.45);
}

}  // namespace
}  // namespace selenograph::engine
