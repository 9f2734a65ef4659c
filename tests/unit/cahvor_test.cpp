// CAHVOR and CAHVORE against their published equations on vectors, their inverse, their bounds, and the pinholes that
// they are in special cases.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "engine/camera/view.h"

namespace selenograph::engine {
namespace {

// Gennery (2006), eqs. (8) to (14), with the entrance pupil in C: projects a direction without planes or rotations.
Vec2 published(const Cahvor& c, const Vec3& p) {
  const double zeta = p.dot(c.o);
  const Vec3 lambda = p - zeta * c.o;
  const double theta = std::atan2(lambda.norm(), zeta), angle = c.linearity * theta;
  if (theta == 0) return Vec2(c.h.dot(p), c.v.dot(p)) / c.a.dot(p);
  const double chi = c.linearity > 0   ? std::tan(angle) / c.linearity
                     : c.linearity < 0 ? std::sin(angle) / c.linearity
                                       : theta;
  const double mu = c.r[0] + c.r[1] * chi * chi + c.r[2] * std::pow(chi, 4);
  const Vec3 moved = lambda.norm() / chi * c.o + (1 + mu) * lambda;
  return Vec2(c.h.dot(moved), c.v.dot(moved)) / c.a.dot(moved);
}

Vec3 turned(const Vec3& v, double about_x_deg, double about_y_deg) {
  return AngleAxis(about_y_deg * kRadiansPerDegree, Vec3::unit_y()) *
         AngleAxis(about_x_deg * kRadiansPerDegree, Vec3::unit_x()) * v;
}

Camera camera_of(const Cahvor& cahvor) {
  Camera camera{320, 256, cahvor.fx(), cahvor.fy(), cahvor.cx(), cahvor.cy(), {}};
  camera.cahvor = cahvor;
  return camera;
}

// A narrow lens, a wide one with all that can be off its axes, and CAHVORE's kinds.
std::vector<Camera> vector_cameras() {
  std::vector<Camera> all;
  const Vec3 a = turned(Vec3::unit_z(), 1.5, -2), o = turned(Vec3::unit_z(), -0.7, 1.1);
  const Vec3 across = turned(Vec3::unit_x(), 1.5, -2), down = turned(Vec3(0.002, 1, 0), 1.5, -2);
  for (const double linearity : {1.0, 0.6, 0.0, -0.5, -1.0}) {
    const double f = linearity == 1 ? 400 : linearity < 0 ? 280 : 200;
    all.push_back(camera_of({a, f * across + 161 * a, 1.01 * f * down + 125 * a, o, {0.002, -0.05, 0.01}, linearity}));
  }
  return all;
}

TEST(CahvorTest, ProjectsAsPublished) {
  for (const Camera& camera : vector_cameras()) {
    const Projection projection(camera);
    for (double x = -0.35; x <= 0.35; x += 0.07)
      for (double y = -0.28; y <= 0.28; y += 0.07) {
        const Vec3 point(x, y, 1);
        const auto pixel = projection.image(12 * point);
        ASSERT_TRUE(pixel);
        const Vec2 expected = published(*camera.cahvor, point);
        EXPECT_NEAR(pixel->x, expected.x(), 1e-9) << camera.cahvor->linearity;
        EXPECT_NEAR(pixel->y, expected.y(), 1e-9) << camera.cahvor->linearity;
      }
  }
}

TEST(CahvorTest, DirectionsInvertPixelsUpToTheBorders) {
  for (const Camera& camera : vector_cameras()) {
    const Projection projection(camera);
    for (double x = -0.5; x <= camera.width - 0.5; x += 31.9)
      for (double y = -0.5; y <= camera.height - 0.5; y += 25.5) {
        const auto direction = projection.direction(x, y);
        ASSERT_TRUE(direction) << camera.cahvor->linearity << ": " << x << ' ' << y;
        const Vec2 back = published(*camera.cahvor, *direction);
        EXPECT_NEAR(back.x(), x, 1e-8);
        EXPECT_NEAR(back.y(), y, 1e-8);
      }
  }
}

TEST(CahvorTest, JacobianIsTheDerivative) {
  for (const Camera& camera : vector_cameras()) {
    const Lens lens(camera);
    const double h = 1e-6;
    const Mat2 j = lens.jacobian(0.3, -0.2);
    EXPECT_LT((j.col(0) - (lens.distorted(0.3 + h, -0.2) - lens.distorted(0.3 - h, -0.2)) / (2 * h)).norm(), 1e-9);
    EXPECT_LT((j.col(1) - (lens.distorted(0.3, -0.2 + h) - lens.distorted(0.3, -0.2 - h)) / (2 * h)).norm(), 1e-9);
  }
}

// With A = O the image is symmetric about the principal point.
TEST(CahvorTest, IsRadiallySymmetricIfTheOpticalAxisIsSquareToTheSensor) {
  for (const double linearity : {1.0, 0.3, 0.0, -1.0}) {
    const Cahvor c{Vec3::unit_z(), {200, 0, 159.5}, {0, 200, 127.5}, Vec3::unit_z(), {0.01, -0.03, 0.002}, linearity};
    const Projection projection(camera_of(c));
    const auto along = projection.image({0.5, 0, 1});
    for (double angle = 0.3; angle < 6.3; angle += 0.5) {
      const auto pixel = projection.image({0.5 * std::cos(angle), 0.5 * std::sin(angle), 1});
      EXPECT_NEAR(std::hypot(pixel->x - 159.5, pixel->y - 127.5), along->x - 159.5, 1e-11);
      EXPECT_NEAR(std::atan2(pixel->y - 127.5, pixel->x - 159.5), std::remainder(angle, 2 * std::numbers::pi), 1e-12);
    }
  }
}

// Three closed forms of CAHVORE without distortion: the radius is f theta, f sin theta, f tan theta.
TEST(CahvorTest, FisheyesInClosedForm) {
  Cahvor c{Vec3::unit_z(), {100, 0, 159.5}, {0, 100, 127.5}};
  for (double theta_deg = 1; theta_deg < 89; theta_deg += 4) {
    const double theta = theta_deg * kRadiansPerDegree;
    const Vec3 direction(0.6 * std::sin(theta), 0.8 * std::sin(theta), std::cos(theta));
    for (const auto& [linearity, radius] :
         {std::pair(0.0, theta), {-1.0, std::sin(theta)}, {1.0, std::tan(theta)}, {0.5, 2 * std::tan(theta / 2)}}) {
      c.linearity = linearity;
      const auto pixel = Projection(camera_of(c)).image(direction);
      ASSERT_TRUE(pixel) << theta_deg;
      EXPECT_NEAR(pixel->x, 159.5 + 60 * radius, 1e-9 * radius * 100) << linearity;
      EXPECT_NEAR(pixel->y, 127.5 + 80 * radius, 1e-9 * radius * 100) << linearity;
    }
  }
}

// chi (1 + r1 chi^2) turns where 1 + 3 r1 chi^2 = 0, for a fisheye at theta = chi.
TEST(CahvorTest, EndsWhereTheRadiusTurns) {
  const Cahvor c{Vec3::unit_z(), {100, 0, 159.5}, {0, 100, 127.5}, Vec3::unit_z(), {0, -0.2, 0}, 0};
  const Projection projection(camera_of(c));
  const double fold = 1 / std::sqrt(0.6);
  const auto toward = [](double theta) { return Vec3(std::sin(theta), 0, std::cos(theta)); };
  EXPECT_TRUE(projection.image(toward(0.999 * fold)));
  EXPECT_FALSE(projection.image(toward(1.001 * fold)));
  const double image_px = 159.5 + 100 * fold * 2 / 3;
  EXPECT_TRUE(projection.direction(image_px - 0.01, 127.5));
  EXPECT_FALSE(projection.direction(image_px + 0.01, 127.5));
}

// The same picture by another lens: CAHVOR with A = O along the boresight is Brown's polynomial k1, k2.
TEST(CahvorTest, IsBrownsPolynomialOnTheAxis) {
  const Cahvor c{Vec3::unit_z(), {300, 0, 160}, {0, 310, 120}, Vec3::unit_z(), {0, -0.2, 0.03}};
  Camera brown{320, 256, 300, 310, 160, 120, {-0.2, 0.03}};
  const Projection vectors(camera_of(c)), polynomial(brown);
  for (double x = -0.5; x <= 320; x += 40)
    for (double y = -0.5; y <= 256; y += 32) {
      const auto a = vectors.direction(x, y), b = polynomial.direction(x, y);
      ASSERT_TRUE(a && b);
      EXPECT_LT((*a - *b).norm(), 1e-13);
    }
}

// The largest image displacement by an angle, over the image, against the bound by distance.
TEST(CahvorTest, BoundsTheScaleOfTheImage) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> any(0, 1);
  for (const Camera& camera : vector_cameras()) {
    const View view(camera, {{2e6, 0, 0}, Quat::identity()});
    double largest = 0;
    for (int i = 0; i < 4000; ++i) {
      const auto ray = view.ray(-0.5 + camera.width * any(random), -0.5 + camera.height * any(random));
      ASSERT_TRUE(ray);
      const Vec3 d = ray->normalized(), across = d.unit_orthogonal();
      const double angle = 7 * any(random), h = 1e-6;
      const Vec3 step = h * (std::cos(angle) * across + std::sin(angle) * d.cross(across));
      const auto from = view.projection().image(d), to = view.projection().image(d + step);
      if (from && to) largest = std::max(largest, std::hypot(to->x - from->x, to->y - from->y) / h);
    }
    EXPECT_LE(largest, view.pixels_per_metre_from(1) * (1 + 1e-6)) << camera.cahvor->linearity;
    EXPECT_GT(largest * 1.1, view.pixels_per_metre_from(1)) << camera.cahvor->linearity;
  }
}

}  // namespace
}  // namespace selenograph::engine
