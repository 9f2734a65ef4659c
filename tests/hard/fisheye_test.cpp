// Frames through a fisheye, over a Moon without relief: every product has a closed form, also behind the camera's
// plane.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/hard_views.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {
namespace {

constexpr double kFinestSag_m = 0.0021;  // of the finest mesh's chords, level 8

class FisheyeFrames : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    write_global_tile(folder_->path(), 1, [](double, double) { return 0.0; });
    renderer_ = new engine::Renderer(open_terrain(folder_->path()), {1, std::size_t{512} << 20});
  }
  static void TearDownTestSuite() {
    delete renderer_, delete folder_;
    renderer_ = nullptr, folder_ = nullptr;
  }
  static const engine::Renderer& renderer() { return *renderer_; }

 private:
  static inline TemporaryFolder* folder_ = nullptr;
  static inline engine::Renderer* renderer_ = nullptr;
};

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

// Distance to the sphere lowered by `sag_m` at the angle theta from the nadir; NaN beyond the horizon.
double distance_to_sphere(double height_m, double theta, double sag_m) {
  const double r = kMoonRadius_m + height_m, radius = kMoonRadius_m - sag_m, along = r * std::cos(theta);
  const double root2 = along * along - (r * r - radius * radius);
  return along > 0 && root2 >= 0 ? (r * r - radius * radius) / (along + std::sqrt(root2)) : std::nan("");
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
  for (int y = 0; y < 97; ++y)
    for (int x = 0; x < 97; ++x) {
      const auto i = static_cast<std::size_t>(y * 97 + x);
      const double theta = std::hypot(x - 48, y - 48) / q.camera.fx;
      const bool imaged = theta < 179 * kDegree;
      const double from_nadir = up ? std::numbers::pi - theta : theta;
      const double nearest = distance_to_sphere(height_m, from_nadir, 0),
                   farthest = distance_to_sphere(height_m, from_nadir, sag_m);
      const double range = frame.products.range[i];
      if (!imaged || std::isnan(nearest)) {
        EXPECT_TRUE(std::isnan(range)) << x << ' ' << y;
        EXPECT_EQ(frame.products.radiance[i], 0.F);
        ++misses;
        continue;
      }
      if (std::isnan(farthest)) continue;  // within the sag of the horizon
      ++hits;
      ASSERT_GE(range, nearest - 1e-6) << x << ' ' << y;
      ASSERT_LE(range, farthest + 1e-6) << x << ' ' << y;
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

TEST_F(FisheyeFrames, NotByZBuffer) {
  const Vec3 eye = to_cartesian({12, 34, 20000});
  engine::FrameRequest q = fisheye_view(looking(eye, -eye, local_axes(eye).north), 32, 80);
  q.visibility = engine::Visibility::zbuffer;
  EXPECT_THROW(renderer().render(q), ImpossibleRequest);
}

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
