// How many moments an exposure in motion is averaged over.
#include "engine/frames/motion_blur.h"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/sensor/sensor.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

FrameRequest looking_down(double height_m) {
  FrameRequest request;
  request.camera = test::square_camera(512, 40);
  const Vec3 eye = to_cartesian({10, 20, height_m});
  request.pose = test::looking(eye, -eye, local_axes(eye).north);
  request.sensor.emplace();
  return request;
}

TEST(MotionBlur, TheStreakOfAFlight) {
  const double kHeight_m = 10000, kGround_m = 1500, kSpeed_m_s = 1600, kTime_s = 0.05;
  FrameRequest request = looking_down(kHeight_m);
  request.sensor->motion.velocity_m_s = kSpeed_m_s * local_axes(request.pose.position_m).east;
  const double expected = request.camera.fx * kSpeed_m_s * kTime_s / (kHeight_m - kGround_m);
  EXPECT_NEAR(longest_streak_px(request, kTime_s, kGround_m, {}), expected, 0.02 * expected);
  // Twice as long, twice as far.
  EXPECT_NEAR(longest_streak_px(request, 2 * kTime_s, kGround_m, {}), 2 * expected, 0.04 * expected);
  EXPECT_EQ(longest_streak_px(request, 0, kGround_m, {}), 0);
  // Without ground there is nothing that moves but objects: 100 m ahead, and behind the camera.
  request.terrain = false;
  EXPECT_LT(longest_streak_px(request, kTime_s, kGround_m, {}), 0.01);
  const Vec3 down = -request.pose.position_m.normalized();
  const Ball ahead{request.pose.position_m + 110 * down, 10}, behind{request.pose.position_m - 110 * down, 10};
  EXPECT_NEAR(longest_streak_px(request, 0.001, kGround_m, std::vector{ahead}), request.camera.fx * 1.6 / 100, 0.2);
  EXPECT_LT(longest_streak_px(request, kTime_s, kGround_m, std::vector{behind}), 0.01);
}

TEST(MotionBlur, TheStreakOfATurn) {
  FrameRequest request = looking_down(1e6);
  request.sensor->motion.angular_rate_deg_s = Vec3(0, 0, 3);
  // About the boresight the corners go farthest: along an arc.
  const double corner = 511 / std::sqrt(2.0), turned = 3 * M_PI / 180 * 0.5;
  EXPECT_NEAR(longest_streak_px(request, 0.5, 0, {}), corner * turned, 0.01);
  // The way counts, not what is between its ends: a whole turn brings all back.
  request.sensor->motion.angular_rate_deg_s = Vec3(0, 0, 720);
  EXPECT_GT(longest_streak_px(request, 0.5, 0, {}), 600);
}

// A pushbroom that flies along its +y, by 1.02 lines per line time: over 32 stages the image is ahead by 0.64 lines.
TEST(MotionBlur, TheDriftOfDelayedIntegration) {
  FrameRequest request = looking_down(20000);
  request.camera.height = 65;
  const double line_time_s = 0.01, line_m = 20000 / request.camera.fx;
  Shutter& shutter = request.shutter.emplace();
  shutter.line_time_s = line_time_s;
  shutter.pushbroom = true;
  const Vec3 ahead = request.pose.camera_from_moon.conjugate() * Vec3::unit_y();
  const auto drift_px = [&](double lines, bool reversed) {
    shutter.rates.velocity_m_s = lines * line_m / line_time_s * ahead;
    request.sensor->tdi = {32, reversed};
    return longest_streak_px(request, exposure_s(request, 1), 0, {});
  };
  EXPECT_NEAR(drift_px(1.02, false), 0.64, 0.02);
  EXPECT_NEAR(drift_px(0.95, false), 1.6, 0.03);
  EXPECT_LT(drift_px(1, false), 0.03);  // the flight is straight, the ground is not
  EXPECT_LT(drift_px(-1, true), 0.03);
  EXPECT_NEAR(drift_px(1, true), 64, 0.1);
  EXPECT_NEAR(exposure_s(request, 1), 0.32, 1e-15);
}

TEST(MotionBlur, AsManyMomentsAsPixels) {
  SensorModel sensor;
  for (const auto& [streak_px, samples] :
       {std::pair{0.0, 1}, {0.9, 1}, {1.5, 3}, {3.0, 3}, {3.1, 5}, {40.0, 41}, {64.5, 65}, {1e9, 65}})
    EXPECT_EQ(exposure_sample_count(sensor, streak_px), samples) << streak_px;
  EXPECT_EQ(exposure_sample_count(sensor, INFINITY), 65);
  sensor.motion.samples = 4;
  EXPECT_EQ(exposure_sample_count(sensor, 40), 4);
  const auto moments = exposure_sample_times_s(4, 0.8);
  ASSERT_EQ(moments.size(), 4U);
  EXPECT_NEAR(moments[0], -0.3, 1e-15);
  EXPECT_NEAR(moments[3], 0.3, 1e-15);
  EXPECT_EQ(exposure_sample_times_s(3, 1)[1], 0);
}

}  // namespace
}  // namespace selenograph::engine
