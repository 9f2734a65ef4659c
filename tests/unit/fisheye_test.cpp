// The fisheye against its closed forms and against OpenCV.
#include "engine/camera/fisheye.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "engine/camera/pixel_rays.h"
#include "engine/camera/view.h"
#include "tests/support/vec_text.h"

namespace selenograph::engine {
namespace {

Camera fisheye_camera(int width, int height, double focal_px, const FisheyeDistortion& d = {}) {
  Camera camera{width, height, focal_px, focal_px, (width - 1) / 2.0, (height - 1) / 2.0, {}};
  camera.model = CameraModel::fisheye, camera.fisheye = d;
  return camera;
}

// Where a direction in camera axes is imaged by a camera at the origin whose axes are MOON_ME's.
std::optional<PixelXY> imaged(const Camera& camera, const Vec3& direction) {
  return View(camera, {Vec3::zero(), Quat::identity()}).project(1000 * direction);
}

TEST(Fisheye, EquidistantImagesAnglesAsRadii) {
  const Camera camera = fisheye_camera(701, 701, 100);
  for (const double theta_deg : {0.0, 1e-6, 30.0, 89.9, 90.0, 135.0, 178.9}) {
    const double theta = theta_deg * std::numbers::pi / 180;
    const auto p = imaged(camera, Vec3(std::sin(theta) * 0.6, std::sin(theta) * 0.8, std::cos(theta)));
    ASSERT_TRUE(p) << theta_deg;
    EXPECT_NEAR(p->x, 350 + 60 * theta, 1e-11) << theta_deg;
    EXPECT_NEAR(p->y, 350 + 80 * theta, 1e-11) << theta_deg;
  }
  EXPECT_FALSE(imaged(camera, Vec3(0, 0.001, -1))) << "straight behind";
}

// cv2.fisheye.projectPoints of OpenCV 4.6.
TEST(Fisheye, KannalaBrandtIsOpenCvs) {
  Camera camera{512, 512, 310, 305, 255.5, 260.25, {}};
  camera.model = CameraModel::fisheye, camera.fisheye = {0.05, -0.01, 0.002, -0.0003};
  struct Case {
    Vec3 point;
    double x, y;
  };
  for (const Case& c :
       {Case{{0.3, -0.2, 1}, 345.279745853448, 201.362209709029},
        Case{{1.5, 0.7, 1}, 556.686667375978, 398.536781687680}, Case{{-6, 2, 1}, -189.941277005875, 406.335580093325},
        Case{{0, 25, 1}, 255.5, 764.008958183594}}) {
    const auto p = imaged(camera, c.point);
    ASSERT_TRUE(p);
    EXPECT_NEAR(p->x, c.x, 1e-9);
    EXPECT_NEAR(p->y, c.y, 1e-9);
  }
}

TEST(Fisheye, EndsWhereThePolynomialTurns) {
  EXPECT_DOUBLE_EQ(Fisheye(FisheyeDistortion{}).limit(), Fisheye::kWidest);
  // 1 + 3 k1 theta^2 = 0.
  EXPECT_NEAR(Fisheye({-0.2, 0, 0, 0}).limit(), std::sqrt(1 / 0.6), 1e-12);
  // 1 + 9 k4 theta^8 = 0.
  EXPECT_NEAR(Fisheye({0, 0, 0, -0.01}).limit(), std::pow(1 / 0.09, 1.0 / 8), 1e-12);
  const Fisheye folded({-0.2, 0, 0, 0});
  EXPECT_TRUE(folded.angle(folded.radius(folded.limit())));
  EXPECT_FALSE(folded.angle(folded.radius(folded.limit()) + 1e-9));
  EXPECT_FALSE(imaged(fisheye_camera(64, 64, 20, {-0.2, 0, 0, 0}), Vec3(std::sin(1.3), 0, std::cos(1.3))));
}

TEST(Fisheye, PixelsComeBackToThemselves) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  std::size_t seen = 0, beyond = 0;
  for (int k = 0; k < 40; ++k) {
    const FisheyeDistortion d{0.1 * normal(random), 0.03 * normal(random), 0.01 * normal(random),
                              0.003 * normal(random)};
    const Camera camera = fisheye_camera(120, 90, 22, k == 0 ? FisheyeDistortion{} : d);
    const View view(camera, {Vec3(2e6, -1e5, 3e4), Quat(0.5, -0.1, 0.7, 0.2).normalized()});
    const Fisheye& fisheye = *view.projection().fisheye();
    const PixelRays rays(camera, 0.25, -0.25);
    for (int y = 0; y < camera.height; y += 3)
      for (int x = 0; x < camera.width; x += 3) {
        const auto ray = view.ray(x + 0.25, y - 0.25);
        const double radius = std::hypot(x + 0.25 - camera.cx, y - 0.25 - camera.cy) / 22;
        ASSERT_EQ(ray.has_value(), radius <= fisheye.radius(fisheye.limit()));
        const auto at = static_cast<std::size_t>(y * camera.width + x);
        ASSERT_EQ(std::isnan(rays.z[at]), !ray);
        if (!ray) {
          ++beyond;
          continue;
        }
        ++seen;
        ASSERT_NEAR(ray->norm(), 1, 1e-15 * 8);
        ASSERT_LT((view.moon_from_camera() * Vec3(rays.x[at], rays.y[at], rays.z[at]) - *ray).norm(), 1e-15 * 8);
        const auto back = view.project(view.position() + 5000 * *ray);
        ASSERT_TRUE(back);
        // Next to the fold the image hardly moves with the angle; elsewhere rounding is all that is lost.
        EXPECT_NEAR(back->x, x + 0.25, 1e-9);
        EXPECT_NEAR(back->y, y - 0.25, 1e-9);
        EXPECT_NEAR(view.depth(*ray, 7), 7 * std::cos(*fisheye.angle(radius)), 1e-14 * 7);
      }
  }
  EXPECT_GT(seen, 20000U);
  EXPECT_GT(beyond, 1000U);
}

TEST(Fisheye, LargestScaleBoundsBothScales) {
  std::mt19937_64 random(6);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(0, 1);
  for (int k = 0; k < 200; ++k) {
    const Fisheye fisheye({0.1 * normal(random), 0.03 * normal(random), 0.01 * normal(random), 0.003 * normal(random)});
    const double a = fisheye.limit() * unit(random), b = fisheye.limit() * unit(random);
    const double bound = fisheye.largest_scale(std::min(a, b), std::max(a, b));
    for (int i = 0; i <= 1000; ++i) {
      const double theta = a + (b - a) * i / 1000;
      ASSERT_LE(fisheye.slope(theta), bound);
      ASSERT_LE(fisheye.radius(theta) / std::sin(std::max(theta, 1e-9)), bound * (1 + 1e-9));
    }
  }
}

// A ball that is partly in the image is never missed, one far beside the field of view never taken.
TEST(Fisheye, BallsInView) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  const Camera camera = fisheye_camera(80, 80, 18);  // to 127 degrees at the middles of its sides, 178 in its corners
  const View view(camera, {Vec3::zero(), Quat::identity()});
  std::size_t inside = 0;
  for (int k = 0; k < 20000; ++k) {
    const Vec3 centre = 100 * Vec3(normal(random), normal(random), normal(random));
    const double radius = 20 * std::abs(normal(random));
    const Vec3 within = centre + 0.99 * radius * Vec3(normal(random), normal(random), normal(random)).normalized();
    const auto p = view.project(within);
    const bool in_image = p && p->x >= -0.5 && p->x < 79.5 && p->y >= -0.5 && p->y < 79.5;
    inside += in_image ? 1 : 0;
    ASSERT_TRUE(!in_image || view.may_see(centre, radius)) << centre << " " << radius;
  }
  EXPECT_GT(inside, 5000U);
  const View narrow(fisheye_camera(80, 80, 100), {Vec3::zero(), Quat::identity()});
  EXPECT_FALSE(narrow.may_see(Vec3(100, 0, 0), 1));
  EXPECT_FALSE(narrow.may_see(Vec3(0, 0, -100), 1));
}

// The bound that level of detail rests on: no displacement within a ball moves its image by more.
TEST(Fisheye, PixelsPerMetreIsABound) {
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  const View view(fisheye_camera(80, 80, 18, {-0.02, 0.004, 0, 0}), {Vec3::zero(), Quat::identity()});
  for (int k = 0; k < 20000; ++k) {
    const Vec3 centre = 1000 * Vec3(normal(random), normal(random), normal(random)),
               off(normal(random), normal(random), normal(random));
    const double radius = 0.2 * centre.norm();
    const Vec3 place = centre + 0.9 * radius * off.normalized(), moved = place + 0.01 * off.cross(centre).normalized();
    const auto a = view.project(place), b = view.project(moved);
    const auto seen = [](const auto& p) { return p && std::abs(p->x - 39.5) < 40 && std::abs(p->y - 39.5) < 40; };
    if (!seen(a) || !seen(b)) continue;
    ASSERT_LE(std::hypot(a->x - b->x, a->y - b->y), 0.01 * view.pixels_per_metre(centre, radius) * (1 + 1e-6));
  }
}

}  // namespace
}  // namespace selenograph::engine
