// Fits of the poses of rows: exact at three rows, close to all rows of a band, and far off where the camera shakes.
#include "engine/camera/row_fit.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

using test::kDegree;

constexpr double kHeight_m = 15000;
const Camera kCamera{320, 200, 1000, 1000, 159.5, 99.5, {}};

Pose above_the_equator() {
  const Vec3 from((kMoonRadius_m + kHeight_m), 0, 0);
  return test::looking(from, -from, Vec3::unit_z());
}

Shutter at_rates(const Rates& rates) {
  Shutter shutter;
  shutter.line_time_s = 0.001;
  shutter.rates = rates;
  return shutter;
}

// Returns the image position of a point by a fit.
PixelXY image_by(const RowFit& fit, const Vec3& origin, const Vec3& point, double row) {
  const Vec3 p = fit.at(row - fit.middle_row) * (point - origin);
  return {p.x() / p.z() * kCamera.fx + kCamera.cx, p.y() / p.z() * kCamera.fy + kCamera.cy};
}

TEST(RowFit, ProjectsAsTheViewsOfItsRows) {
  // 20 pixels by rotation and as many by translation while 100 rows are exposed.
  const RowViews views(kCamera, above_the_equator(), at_rates({Vec3(12, -5, 8), Vec3(-300, 2000, 1000)}));
  const Vec3 origin = views.reference().position() + Vec3(3, -2, 1), point(kMoonRadius_m, 900, -700);
  for (const int row : {0, 50, 100, 199}) {
    const RowFit fit(views, row, origin);
    EXPECT_NEAR(fit.middle_row, row, 1);
    for (int other = std::max(row - 64, 0); other <= std::min(row + 64, 199); ++other) {
      const auto exact = views.of(other).project(point);
      ASSERT_TRUE(exact);
      const bool is_fitted = other == fit.middle_row || std::abs(other - fit.middle_row) == RowFit::kReach;
      const double tolerance_px = is_fitted ? 1e-8 : 1e-3;
      const PixelXY fitted = image_by(fit, origin, point, other);
      EXPECT_NEAR(fitted.x, exact->x, tolerance_px) << row << " " << other;
      EXPECT_NEAR(fitted.y, exact->y, tolerance_px) << row << " " << other;
    }
  }
}

TEST(RowFit, ErrorIsSmallForSteadyMotionAndLargeForShaking) {
  const RowViews steady(kCamera, above_the_equator(), at_rates({Vec3(12, -5, 8), Vec3(-300, 2000, 1000)}));
  EXPECT_LT(max_fit_error_px(steady, kHeight_m), 2e-3);
  Shutter shaking;
  shaking.line_time_s = 0.001;
  for (int i = 0; i <= 20; ++i) {
    Pose pose = above_the_equator();
    const double angle = 0.1 * kDegree * (i % 2);
    pose.camera_from_moon = AngleAxis(angle, Vec3::unit_x()) * pose.camera_from_moon;
    shaking.poses.push_back({0.01 * i, pose});
  }
  EXPECT_GT(max_fit_error_px(RowViews(kCamera, {}, shaking), kHeight_m), 0.5);
}

}  // namespace
}  // namespace selenograph::engine
