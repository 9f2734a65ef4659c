// Cameras: rays and projection undo each other, folds answer nothing, bounds bound.
#include "engine/camera/view.h"

#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <array>
#include <cmath>
#include <random>

#include "dem/base/error.h"

namespace selenograph::engine {
namespace {

Camera plain_camera() { return {640, 480, 500, 510, 319.5, 239.5, {}}; }

std::vector<Camera> cameras() {
  std::vector<Camera> all{
      plain_camera(), {64, 64, 5000, 5000, 31.5, 31.5, {}}, {1000, 100, 200, 220, 700.25, -30.5, {}}};
  for (const Distortion& d :
       {Distortion{-0.35, 0.12, -0.02, 0.001, -0.0007}, Distortion{0.4, 0.2, 0.1, -0.01, 0.02},
        Distortion{-0.2, 0, 0, 0.03, 0.03}, Distortion{-0.45, 0, 0, 0, 0}, Distortion{0.1, -0.4, 0, 0, 0}}) {
    Camera c = plain_camera();
    c.distortion = d;
    all.push_back(c);
  }
  all.push_back(plain_camera());
  all.back().distortion = {0.9, 0.2, 0.01, 0.001, -0.002, 1.3, 0.45, 0.06, 0.003, -0.001, -0.002, 0.0005, 4, -7};
  all.push_back(plain_camera());
  all.back().cahvor = Cahvor{Vec3(0.02, 0.01, 1).normalized(),  {240, 1, 330},        {-2, 250, 230},
                             Vec3(-0.01, 0.02, 1).normalized(), {0.01, -0.02, 0.003}, 0.1};
  all.back().fx = all.back().cahvor->fx();
  all.back().fy = all.back().cahvor->fy();
  all.back().cx = all.back().cahvor->cx();
  all.back().cy = all.back().cahvor->cy();
  return all;
}

Pose some_pose() { return {{1800000, -30000, 50000}, Quat(0.3, -0.7, 0.2, 0.5).normalized()}; }

TEST(View, PinholeByHand) {
  const Camera c{100, 80, 200, 100, 49.5, 39.5, {}};
  // Boresight along -x of the Moon, image right along +y, down along -z.
  const auto camera_from_moon = Mat3::from_rows({0, 1, 0}, {0, 0, -1}, {-1, 0, 0});
  const View view(c, {{2000000, 0, 0}, Quat(camera_from_moon)});
  EXPECT_LT((*view.ray(49.5, 39.5) - Vec3(-1, 0, 0)).norm(), 1e-15);
  EXPECT_LT((*view.ray(69.5, 39.5) - Vec3(-1, 0.1, 0)).norm(), 1e-15);
  EXPECT_LT((*view.ray(49.5, 59.5) - Vec3(-1, 0, -0.2)).norm(), 1e-15);
  const auto p = view.project({1999000, 100, 50});
  EXPECT_NEAR(p->x, 49.5 + 200 * 0.1, 1e-9);
  EXPECT_NEAR(p->y, 39.5 - 100 * 0.05, 1e-9);
  EXPECT_FALSE(view.project({2000001, 0, 0})) << "behind";
  EXPECT_FALSE(view.project({2000000, 5, 0})) << "beside";
}

TEST(View, RaysAndProjectionAreInverse) {
  for (const Camera& camera : cameras()) {
    const View view(camera, some_pose());
    std::size_t seen = 0;
    for (int j = 0; j <= 40; ++j)
      for (int i = 0; i <= 40; ++i) {
        const double x = -0.5 + camera.width * i / 40.0, y = -0.5 + camera.height * j / 40.0;
        const auto ray = view.ray(x, y);
        if (!ray) continue;
        ++seen;
        EXPECT_NEAR(ray->dot(view.moon_from_camera().col(2)), 1, 1e-12) << "its component along the boresight is 1";
        const auto back = view.project(view.position() + 12345.6 * *ray);
        ASSERT_TRUE(back) << x << ' ' << y;
        ASSERT_NEAR(back->x, x, 1e-7);
        ASSERT_NEAR(back->y, y, 1e-7);
      }
    EXPECT_GT(seen, 300U) << camera.distortion.k1;
  }
}

TEST(View, NoRaysBeyondTheFold) {
  // r (1 - 0.45 r^2) grows up to r = 1 / sqrt(1.35) = 0.861, where it is 0.5738: nothing lands farther out.
  Camera camera{1000, 1000, 500, 500, 499.5, 499.5, {-0.45, 0, 0, 0, 0}};
  const View view(camera, some_pose());
  const double fold = 1 / std::sqrt(1.35), reach = fold * (1 - 0.45 * fold * fold);
  for (double angle = 0; angle < 6.28; angle += 0.1)
    for (double r = 0.01; r < 1.3; r += 0.01) {
      const auto ray = view.ray(499.5 + 500 * r * std::cos(angle), 499.5 + 500 * r * std::sin(angle));
      if (std::abs(r - reach) < 1e-3) continue;
      ASSERT_EQ(ray.has_value(), r < reach) << r;
      if (ray) {
        ASSERT_LE(std::sqrt(ray->squared_norm() - 1), fold * (1 + 1e-9));
      }
    }
  // Points beyond the fold would be folded back into the image: they are not there.
  for (double r = fold + 0.001; r < 20; r *= 1.1)
    EXPECT_FALSE(view.project(view.position() + view.moon_from_camera() * Vec3(r, 0, 1)));
}

TEST(View, MayBeSeenIsConservative) {
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> any(0, 1);
  for (const Camera& camera : cameras()) {
    const View view(camera, some_pose());
    std::size_t hits = 0;
    for (int i = 0; i < 30000; ++i) {
      // A place in the image, border included, at any depth, and a ball that just holds it.
      const double x = i % 3 == 0   ? -0.5
                       : i % 3 == 1 ? camera.width - 0.5
                                    : -0.5 + camera.width * any(random),
                   y = -0.5 + camera.height * any(random);
      const auto ray = view.ray(x, y);
      if (!ray) continue;
      ++hits;
      const Vec3 point = view.position() + *ray * std::pow(10, 6 * any(random));
      const double radius = std::pow(10, 5 * any(random));
      const Vec3 centre =
          point + Vec3(normal(random), normal(random), normal(random)).normalized() * radius * 0.999 * any(random);
      ASSERT_TRUE(view.may_see(centre, radius)) << x << ' ' << y;
      // A triangle that holds it, or passes it by at most a margin.
      const auto corner = [&] { return Vec3(radius * Vec3(normal(random), normal(random), normal(random))); };
      const Vec3 a = corner(), b = corner();
      const double u = any(random), v = (1 - u) * any(random), margin = i % 2 ? 0 : radius * any(random);
      const Vec3 aside = 0.999 * margin * Vec3(normal(random), normal(random), normal(random)).normalized();
      const Vec3 first = point - u * a - v * b + aside;
      const double rounding = 1e-9 * point.norm();
      ASSERT_TRUE(view.may_see(std::array{first, Vec3(first + a), Vec3(first + b)}, margin + rounding));
    }
    EXPECT_GT(hits, 1000U);
  }
}

TEST(View, PointsFarOutsideAreNotSeen) {
  const View view(plain_camera(), some_pose());
  const Mat3& m = view.moon_from_camera();
  EXPECT_FALSE(view.may_see(view.position() + m * Vec3(0, 0, -1000), 10));
  EXPECT_FALSE(view.may_see(view.position() + m * Vec3(1000, 0, 1000), 100));
  EXPECT_FALSE(view.may_see(view.position() + m * Vec3(0, -1000, 1000), 100));
  EXPECT_TRUE(view.may_see(view.position() + m * Vec3(0, 0, -5), 10)) << "the camera is inside";
  // Beside the image all along, though the ball around it reaches far into it.
  const std::array<Vec3, 2> wall{view.position() + m * Vec3(1000, -900, 1000),
                                 view.position() + m * Vec3(1000, 900, 1000)};
  EXPECT_TRUE(view.may_see((wall[0] + wall[1]) / 2, 900));
  EXPECT_FALSE(view.may_see(wall, 100));
  EXPECT_TRUE(view.may_see(wall, 1000)) << "what is within the margin may be";
}

// The largest image displacement of a metre in any direction, by finite differences.
double measured_sharpness(const View& view, const Vec3& point) {
  const auto at = view.project(point);
  Eigen::Matrix<double, 2, 3> jacobian;
  const double h = 1e-5 * (point - view.position()).norm();
  for (int k = 0; k < 3; ++k) {
    const auto moved = view.project(point + h * Mat3::identity().col(k));
    if (!moved) return 0;
    jacobian.col(k) << (moved->x - at->x) / h, (moved->y - at->y) / h;
  }
  return jacobian.jacobiSvd().singularValues()[0];
}

TEST(View, PixelsPerMetreIsAnUpperBound) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> any(0, 1);
  for (const Camera& camera : cameras()) {
    const View view(camera, some_pose());
    double tightest = 1e9;
    for (int i = 0; i < 20000; ++i) {
      const auto ray = view.ray(-0.5 + camera.width * any(random), -0.5 + camera.height * any(random));
      if (!ray) continue;
      const double depth = std::pow(10, 1 + 5 * any(random)), radius = depth * std::pow(10, -4 * any(random));
      const Vec3 point = view.position() + *ray * depth;
      const Vec3 centre =
          point + Vec3(normal(random), normal(random), normal(random)).normalized() * radius * any(random);
      const double measured = measured_sharpness(view, point), bound = view.pixels_per_metre(centre, radius);
      ASSERT_LE(measured, bound * (1 + 1e-4)) << "depth " << depth << ", radius " << radius << ", k1 "
                                              << camera.distortion.k1 << ", p1 " << camera.distortion.p1;
      if (measured > 0) tightest = std::min(tightest, bound / measured);
    }
    EXPECT_LT(tightest, 3) << "never near";
  }
}

TEST(View, ImpossibleCamerasAreRefused) {
  const Pose pose = some_pose();
  for (const Camera& bad :
       {Camera{0, 10, 1, 1, 0, 0, {}}, Camera{10, -1, 1, 1, 0, 0, {}}, Camera{10, 10, 0, 1, 0, 0, {}},
        Camera{10, 10, 1, std::nan(""), 0, 0, {}}, Camera{10, 10, 1, 1, INFINITY, 0, {}}})
    EXPECT_THROW(View(bad, pose), ImpossibleRequest);
  EXPECT_THROW(View(plain_camera(), Pose{{std::nan(""), 0, 0}, Quat::identity()}), ImpossibleRequest);
}

}  // namespace
}  // namespace selenograph::engine
