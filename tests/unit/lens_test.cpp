// The lens against its polynomial, its derivative and its fold in closed form; a pixel's ray against the lens.
#include "engine/camera/lens.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <random>
#include <tuple>

#include "engine/camera/pixel_rays.h"
#include "engine/camera/projection.h"
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
  const Vec2 p = lens.distorted(x, y);
  EXPECT_NEAR(p.x(), x * radial + 2 * 0.006 * x * y - 0.004 * (0.25 + 2 * x * x), 1e-15);
  EXPECT_NEAR(p.y(), y * radial + 0.006 * (0.25 + 2 * y * y) - 2 * 0.004 * x * y, 1e-15);
}

TEST(LensMap, WithoutCoefficientsIsTheIdentityEverywhere) {
  const Lens lens{Distortion{}};
  EXPECT_EQ(lens.distorted(3, -7), Vec2(3, -7));
  EXPECT_EQ(lens.jacobian(3, -7), Mat2(Mat2::identity()));
  EXPECT_TRUE(lens.holds(1e6, 1e6));
  EXPECT_TRUE(std::isinf(lens.reach()));
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

Distortion opencv_terms() {
  return {0.9, 0.2, 0.01, 0.001, -0.002, 1.3, 0.45, 0.06, 0.003, -0.001, -0.002, 0.0005, 4, -7};
}

// cv2.projectPoints of OpenCV 4.6, in pixels.
TEST(OpenCvLens, ProjectsAsOpenCv) {
  struct Case {
    Distortion distortion;
    Vec3 point;
    double x, y;
  };
  const Distortion rational{0.9, 0.2, 0.01, 0, 0, 1.3, 0.45, 0.06},
      prism{-0.2, 0.05, 0, 0.001, -0.002, 0, 0, 0, 0.003, -0.001, -0.002, 0.0005};
  for (const Case& c : {Case{rational, {0.1, -0.05, 1}, 591.103340835504, 343.945850462470},
                        Case{rational, {0.5, 0.3, 1}, 866.894914055954, 593.821486578153},
                        Case{rational, {-0.7, 0.45, 1}, 59.907811825767, 669.930398028464},
                        Case{rational, {1.4, 0.9, 1}, 1140.603641219079, 782.618472238183},
                        Case{prism, {0.1, -0.05, 1}, 591.270500000000, 343.858378125000},
                        Case{prism, {0.5, 0.3, 1}, 886.231520000000, 604.949122000000},
                        Case{prism, {-0.7, 0.45, 1}, 13.730780000000, 698.995062062500},
                        Case{prism, {0.3, -0.8, 2}, 627.271192500000, 78.569142218750},
                        Case{opencv_terms(), {0.1, -0.05, 1}, 592.379678906832, 344.192176715426},
                        Case{opencv_terms(), {0.5, 0.3, 1}, 897.435043610123, 613.657903709613},
                        Case{opencv_terms(), {-0.7, 0.45, 1}, 73.987659748030, 655.673775762599},
                        Case{opencv_terms(), {0.3, -0.8, 2}, 623.480115598070, 90.976798579545},
                        Case{opencv_terms(), {1.4, 0.9, 1}, 1231.161234665926, 847.707510413320}}) {
    const Projection projection(Camera{1024, 768, 800, 790, 511.5, 383.25, c.distortion});
    const auto pixel = projection.image(c.point);
    ASSERT_TRUE(pixel);
    EXPECT_NEAR(pixel->x, c.x, 1e-10);
    EXPECT_NEAR(pixel->y, c.y, 1e-10);
    const auto direction = projection.direction(c.x, c.y);
    ASSERT_TRUE(direction);
    EXPECT_LT((*direction - c.point / c.point.z()).norm(), 1e-12);
  }
}

// cv2.undistortPointsIter of OpenCV 4.6, iterated to 1e-15.
TEST(OpenCvLens, UndistortsAsOpenCv) {
  const Projection projection(Camera{1024, 768, 800, 790, 511.5, 383.25, opencv_terms()});
  for (const auto& [x, y, slope] : {std::tuple(20., 700., Vec2(-8.57815008e-01, 5.70725284e-01)),
                                    {511., 384., Vec2(-6.20346290e-04, 9.52374613e-04)},
                                    {1000., 10., Vec2(7.74415432e-01, -6.08228759e-01)}}) {
    const auto direction = projection.direction(x, y);
    ASSERT_TRUE(direction);
    EXPECT_LT((direction->xy() - slope).norm(), 1e-8);
  }
}

TEST(OpenCvLens, JacobianIsTheDerivative) {
  const Lens lens(opencv_terms());
  const double h = 1e-6;
  const Mat2 j = lens.jacobian(0.3, -0.4);
  EXPECT_LT((j.col(0) - (lens.distorted(0.3 + h, -0.4) - lens.distorted(0.3 - h, -0.4)) / (2 * h)).norm(), 1e-9);
  EXPECT_LT((j.col(1) - (lens.distorted(0.3, -0.4 + h) - lens.distorted(0.3, -0.4 - h)) / (2 * h)).norm(), 1e-9);
}

// r / (1 + k4 r^2) turns at 1 / sqrt(k4), where it is half of that.
TEST(OpenCvLens, EndsWhereTheQuotientTurns) {
  Distortion d;
  d.k4 = 0.4;
  const Lens lens(d);
  const double fold = 1 / std::sqrt(0.4);
  EXPECT_NEAR(lens.reach(), fold, 1e-9);
  EXPECT_TRUE(lens.holds(0.999 * fold, 0));
  EXPECT_FALSE(lens.holds(0, 1.001 * fold));
  EXPECT_TRUE(lens.undistorted(0.499 * fold, 0));
  EXPECT_FALSE(lens.undistorted(0.501 * fold, 0));
}

// r / (1 - r^2 / 4) is imaged at infinity at r = 2: beyond this pole it would return from the other side. A pole that
// a search in steps would miss ends the lens, too.
TEST(OpenCvLens, EndsAtThePole) {
  Distortion d;
  d.k4 = -0.25;
  const Lens lens(d);
  EXPECT_NEAR(lens.reach(), 2, 1e-12);
  EXPECT_TRUE(lens.holds(1.999, 0));
  EXPECT_FALSE(lens.holds(2.001, 0));
  const auto far = lens.undistorted(-1e6, 0);
  ASSERT_TRUE(far);
  EXPECT_NEAR(far->x(), -2, 1e-5);
  // (1 - r^2)(1 - r^2 / 1.0001) is below zero on a 20 000th of the radius only; the numerator hides the fold before it.
  Distortion narrow;
  narrow.k4 = -1 - 1 / 1.0001;
  narrow.k5 = 1 / 1.0001;
  narrow.k1 = narrow.k4 + 1e-9;
  narrow.k2 = narrow.k5;
  EXPECT_NEAR(Lens(narrow).reach(), 1, 0.01);
}

// Without a fold, a lens that is no polynomial images up to 89.9 degrees from its axis.
TEST(OpenCvLens, InvertsUpToTheHorizon) {
  Distortion d;
  d.k1 = 0.5;
  d.k4 = 0.6;
  const Lens lens(d);
  EXPECT_LE(lens.reach(), RadialFactor::kFarthest);
  for (double r = 0.01; r < lens.reach(); r *= 1.5) {
    const Vec2 image = lens.distorted(0.6 * r, 0.8 * r);
    const auto back = lens.undistorted(image.x(), image.y());
    ASSERT_TRUE(back) << r;
    EXPECT_LT((*back - Vec2(0.6 * r, 0.8 * r)).norm(), 1e-12 * r) << r;
  }
}

// Strong lenses of all terms: the inverse is the inverse, and what lies beyond a fold has none.
TEST(OpenCvLens, PositionsThatHoldAreInverted) {
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  std::size_t inverted = 0, beyond = 0;
  for (int i = 0; i < 60; ++i) {
    const auto any = [&](double size) { return size * normal(random); };
    const Lens lens(Distortion{any(0.5), any(0.3), any(0.1), any(0.05), any(0.05), any(0.5), any(0.3), any(0.1),
                               any(0.05), any(0.02), any(0.05), any(0.02), any(8), any(8)});
    for (double x = -1.5; x <= 1.5; x += 0.25)
      for (double y = -1.5; y <= 1.5; y += 0.25) {
        if (!lens.holds(x, y)) {
          ++beyond;
          continue;
        }
        constexpr double kNextToPole = 1000;  // scale at which an image is too far away to be searched for
        if (lens.jacobian(x, y).determinant() > kNextToPole) continue;
        ++inverted;
        const Vec2 image = lens.distorted(x, y);
        const auto back = lens.undistorted(image.x(), image.y());
        ASSERT_TRUE(back) << i << ": " << x << ' ' << y;
        // Close to a fold, rounding of the image is many times as much on the plane.
        EXPECT_LT((lens.jacobian(x, y) * (*back - Vec2(x, y))).norm(), 1e-10 * (1 + image.norm())) << i;
      }
  }
  EXPECT_GT(inverted, 2000U);
  EXPECT_GT(beyond, 1000U);
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
      const Vec2 image = lens.distorted(rays.x[i], rays.y[i]);
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
