// Frames through a fisheye, over a Moon without relief: every product has a closed form, also behind the camera's
// plane.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "tests/support/hard_views.h"
#include "tests/support/moon_without_relief.h"

namespace selenograph::test {
namespace {

using FisheyeFrames = MoonWithoutRelief;

engine::FrameRequest fisheye_view(const engine::Pose& pose, int side, double half_angle_deg) {
  engine::FrameRequest q = blank_request();
  q.camera = square_camera(side, 60);
  q.camera.model = engine::CameraModel::fisheye;
  q.camera.fx = q.camera.fy = side / 2.0 / (half_angle_deg * kDegree);
  q.pose = pose;
  q.visibility = engine::Visibility::automatic;
  q.accuracy.max_error_px = 0.05;
  q.products = engine::kRadiance | engine::kDepth | engine::kRange | engine::kPosition | engine::kLit;
  return q;
}

// `up`: the boresight points away from the Moon, which is then seen behind the camera's plane only.
void expect_closed_form(const engine::Renderer& renderer, double height_m, double half_angle_deg, bool up) {
  const Geographic place{12, 34, height_m};
  const Vec3 eye = to_cartesian(place);
  engine::FrameRequest q = fisheye_view(looking(eye, up ? eye : Vec3(-eye), local_axes(eye).north), 97, half_angle_deg);
  q.sun.direction = local_direction(eye, 70, 40);
  const engine::Frame frame = renderer.render(q);
  EXPECT_EQ(frame.report.visibility, engine::Visibility::raytrace);
  const double sag_m = std::max(kFinestSag_m, frame.report.lod_error_m) * 1.01;
  std::size_t hits = 0, misses = 0;
  const auto distance_to_sphere = [&](double from_nadir, double depth_m) {
    const EastNorthUp axes = local_axes(eye);
    return meet_sphere(eye, std::sin(from_nadir) * axes.east - std::cos(from_nadir) * axes.up, depth_m);
  };
  for (int y = 0; y < 97; ++y)
    for (int x = 0; x < 97; ++x) {
      const auto i = static_cast<std::size_t>(y * 97 + x);
      const double theta = std::hypot(x - 48, y - 48) / q.camera.fx;
      const bool imaged = theta < 179 * kDegree;
      const double from_nadir = up ? std::numbers::pi - theta : theta;
      const auto nearest = distance_to_sphere(from_nadir, 0), farthest = distance_to_sphere(from_nadir, sag_m);
      const double range = frame.products.range[i];
      if (!imaged || !nearest) {
        EXPECT_TRUE(std::isnan(range)) << x << ' ' << y;
        EXPECT_EQ(frame.products.radiance[i], 0.F);
        ++misses;
        continue;
      }
      if (!farthest) continue;  // within the sag of the horizon
      ++hits;
      ASSERT_GE(range, *nearest - 1e-6) << x << ' ' << y;
      ASSERT_LE(range, *farthest + 1e-6) << x << ' ' << y;
      ASSERT_NEAR(frame.products.depth[i], range * std::cos(theta), 1e-9 * range);
      const Vec3 toward = (at3(frame.products.position, i) - eye) / range;
      const Vec3 in_camera = q.pose.camera_from_moon * toward;
      ASSERT_NEAR(in_camera.x(), theta > 0 ? std::sin(theta) * (x - 48) / (theta * q.camera.fx) : 0, 1e-9);
      ASSERT_NEAR(in_camera.y(), theta > 0 ? std::sin(theta) * (y - 48) / (theta * q.camera.fx) : 0, 1e-9);
      const double elevation = at3(frame.products.position, i).normalized().dot(q.sun.direction);
      if (elevation > 0.01) {
        ASSERT_EQ(frame.products.lit[i], 1.F);
        ASSERT_GT(frame.products.radiance[i], 0.F);
      }
    }
  EXPECT_GT(hits, 500U);
  EXPECT_GT(misses, 100U);
}

TEST_F(FisheyeFrames, NadirToTheHorizon) { expect_closed_form(renderer(), 20000, 95, false); }
TEST_F(FisheyeFrames, WholeSphereOfDirections) { expect_closed_form(renderer(), 20000, 185, false); }
TEST_F(FisheyeFrames, GroundBehindTheCamera) { expect_closed_form(renderer(), 20000, 150, true); }
TEST_F(FisheyeFrames, FarAway) { expect_closed_form(renderer(), 3e6, 60, false); }

// Vignetting through cos^4 of the angle from the boresight, and nothing from behind.
TEST_F(FisheyeFrames, Vignetting) {
  const Vec3 eye = to_cartesian({12, 34, 20000});
  engine::FrameRequest q = fisheye_view(looking(eye, local_axes(eye).north, local_axes(eye).up), 64, 120);
  q.sun.direction = local_direction(eye, 70, 40);
  q.products = engine::kRadiance | engine::kImage;
  q.band = engine::Band(0.6, 0.1);
  engine::SensorModel sensor;
  sensor.optics.f_number = 2;
  sensor.detector.pixel_pitch_um = 5, sensor.detector.integration_time_s = 1e-4, sensor.detector.gain_e_dn = 1;
  sensor.detector.bit_depth = 16, sensor.detector.photon_noise = false;
  q.sensor = sensor;
  const engine::Frame open = renderer().render(q);
  q.sensor->optics.vignetting.model = engine::Vignetting::Model::cos4;
  const engine::Frame frame = renderer().render(q);
  std::size_t compared = 0, dark = 0;
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x) {
      const auto i = static_cast<std::size_t>(y * 64 + x);
      const double theta = std::hypot(x - 31.5, y - 31.5) / q.camera.fx, cosine = std::max(0.0, std::cos(theta));
      const double without = open.products.image[i], with = frame.products.image[i];
      if (without < 1000 || without >= 65535) continue;
      ASSERT_NEAR(with, without * std::pow(cosine, 4), 1.0 + 1e-5 * without) << x << ' ' << y;
      ++compared, dark += with == 0 ? 1 : 0;
    }
  EXPECT_GT(compared, 200U);
  EXPECT_GT(dark, 20U);
}

}  // namespace
}  // namespace selenograph::test
