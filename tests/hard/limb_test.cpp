// The limb in the image: in closed form for a Moon without relief, between rays that hit and rays that miss for a rough
// one. Rays go through places of the image, on a line across the limb.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "engine/camera/view.h"
#include "engine/limb_in_view.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/moon_without_relief.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

constexpr double kLimbTolerance_px = 0.01;

// Above a place, near the limb's size, the centre off the middle of the image.
engine::LimbRequest of_whole_disc(double lat_deg, double lon_deg, double height_m, int points) {
  const Vec3 from = to_cartesian({lat_deg, lon_deg, height_m});
  const double radius_deg = std::asin(kMoonRadius_m / from.norm()) / kDegree;
  engine::LimbRequest request;
  request.camera = square_camera(1024, std::min(150.0, 2.4 * radius_deg));
  const EastNorthUp axes = local_axes(from);
  request.pose = looking(from, -from.normalized() + 0.1 * std::tan(radius_deg * kDegree / 2) * axes.east, axes.north);
  request.points = points;
  return request;
}

constexpr double kHeights_m[] = {1e5, 2e6, 2e7, 4e8};

using LimbOfASphere = MoonWithoutRelief;

TEST_F(LimbOfASphere, IsACone) {
  for (const double height_m : kHeights_m) {
    const engine::LimbRequest request = of_whole_disc(20, 30, height_m, 100);
    const engine::View view(request.camera, request.pose);
    const Vec3 from = view.position(), centre = -from.normalized();
    double worst_px = 0;
    for (const engine::LimbPoint& p : renderer().limb(request)) {
      ASSERT_TRUE(p.known());
      EXPECT_NEAR(p.sphere_angle_deg, std::asin(kMoonRadius_m / from.norm()) / kDegree, 1e-12);
      EXPECT_LT(p.position_m.norm(), kMoonRadius_m + 1e-6);
      EXPECT_GT(p.position_m.norm(), kMoonRadius_m - 2 * kFinestSag_m);
      if (!p.in_frame) continue;
      worst_px = std::max(worst_px, std::hypot(p.x_px - p.sphere_x_px, p.y_px - p.sphere_y_px));
      // What the image shows there, and at which azimuth: a small turn of the camera away from the centre.
      const Vec3 ray = view.ray(p.x_px, p.y_px)->normalized();
      EXPECT_NEAR(std::atan2(ray.cross(centre).norm(), ray.dot(centre)) / kDegree, p.angle_deg, 1e-9);
      const auto turn = Eigen::Quaterniond::FromTwoVectors(view.moon_from_camera().col(2), centre);
      const Vec3 turned = view.moon_from_camera().transpose() * (turn.conjugate() * ray);
      EXPECT_NEAR(std::remainder(std::atan2(turned.y(), turned.x()) / kDegree - p.azimuth_deg, 360), 0, 1e-6);
    }
    fmt::print("{:9.0f} km: {:.5f} px from the sphere's at most\n", height_m / 1000, worst_px);
    EXPECT_LT(worst_px, kLimbTolerance_px);
  }
}

TEST_F(LimbOfASphere, FromAFewMetres) {
  engine::LimbRequest request = of_whole_disc(-40, 100, 5, 12);
  for (const engine::LimbPoint& p : renderer().limb(request)) {
    ASSERT_TRUE(p.known());
    EXPECT_NEAR(p.angle_deg, p.sphere_angle_deg, 0.01);
  }
}

class RoughLimb : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    write_global_tile(folder_->path(), 4, [](double lat_deg, double lon_deg) {
      const double round = std::cos(lat_deg * kDegree), lon = lon_deg * kDegree;
      return round * (2500 * std::sin(0.31 * lat_deg) * std::cos(17 * lon) +
                      1500 * std::sin(2.3 * lat_deg + 1) * std::sin(131 * lon) +
                      900 * std::cos(7.1 * lat_deg) * std::cos(517 * lon));
    });
    renderer_ = new engine::Renderer(open_terrain(folder_->path()), {0, std::size_t{1} << 30});
  }
  static void TearDownTestSuite() {
    delete renderer_, delete folder_;
    renderer_ = nullptr, folder_ = nullptr;
  }
  static inline TemporaryFolder* folder_ = nullptr;
  static inline engine::Renderer* renderer_ = nullptr;
};

TEST_F(RoughLimb, IsBetweenRaysThatHitAndRaysThatMiss) {
  for (const double height_m : kHeights_m) {
    const engine::LimbRequest request = of_whole_disc(12, 200, height_m, 1000);
    const engine::View view(request.camera, request.pose);
    const engine::PixelXY centre = *view.project(Vec3::Zero());
    // Across the limb, close to it and far: nothing stands beyond it, nothing is open within it.
    const std::vector<double> offsets_px{-30, -3, -0.3, -0.03, -0.011, 0.011, 0.03, 0.3, 3, 30};
    std::vector<engine::Ray> rays;
    const std::vector<engine::LimbPoint> points = renderer_->limb(request);
    double relief_px = 0;
    for (const engine::LimbPoint& p : points) {
      ASSERT_TRUE(p.known());
      const Vec3 out = Vec3(p.x_px - centre.x, p.y_px - centre.y, 0).normalized();
      for (const double offset : offsets_px)
        rays.push_back({view.position(), view.ray(p.x_px + offset * out.x(), p.y_px + offset * out.y())->normalized()});
      relief_px = std::max(relief_px, std::hypot(p.x_px - p.sphere_x_px, p.y_px - p.sphere_y_px));
    }
    const std::vector<engine::RayHit> hits = renderer_->cast(rays, std::nullopt);
    std::size_t wrong = 0;
    for (std::size_t i = 0; i < hits.size(); ++i) wrong += hits[i].hit != (offsets_px[i % offsets_px.size()] < 0);
    fmt::print("{:9.0f} km: {} of {} rays on the wrong side; up to {:.3f} px from the sphere\n", height_m / 1000, wrong,
               hits.size(), relief_px);
    EXPECT_EQ(points.size(), 1000U);
    EXPECT_GT(relief_px, 0.5);
    EXPECT_EQ(wrong, 0U);
  }
}

// Voids: half of the Moon. Beyond them nobody knows.
TEST(LimbWithVoids, HasNoPointsThere) {
  const TemporaryFolder folder;
  write_float_tile(folder.path(), "east", {60, 0, 4, 4 * 120 + 1, 4 * 180 + 1}, [](double, double) { return 100.0; });
  const engine::Renderer renderer(open_terrain(folder.path()), {1, std::size_t{512} << 20});
  // The northern and southern limb are beyond 60 degrees; the eastern one has data, the western one none.
  engine::LimbRequest request = of_whole_disc(0, 60, 1e7, 40);
  const auto points = renderer.limb(request);
  EXPECT_TRUE(points[0].known());  // east is right
  EXPECT_FALSE(points[10].known());
  EXPECT_FALSE(points[20].known());
  EXPECT_FALSE(points[30].known());
  EXPECT_TRUE(std::isfinite(points[20].sphere_x_px));
  request.pose.position_m = to_cartesian({0, 60, 50});
  EXPECT_THROW(renderer.limb(request), std::runtime_error);
}

}  // namespace
}  // namespace selenograph::test
