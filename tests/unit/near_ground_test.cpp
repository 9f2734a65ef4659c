// Made ground near the camera: the level of detail depends neither on the image's size nor on the pose before, and the
// z-buffer draws it down to a millimetre.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "api/assets/assets.h"
#include "dem/detail/detailed_terrain.h"
#include "engine/renderer.h"
#include "engine/scene/selection.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

constexpr double kLat_deg = 10, kLon_deg = 26;

class NearGround : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder;
    test::write_float_tile(folder_->path(), "t", {12, 24, 128, 4 * 128 + 1, 4 * 128 + 1},
                           [](double lat, double lon) { return 20 * std::sin(lat * 31 + lon * 13); });
    plain_ = test::open_terrain(folder_->path());
    detail_ = std::make_shared<const dem::Detail>(
        api::read_detail_file(SELENOGRAPH_SOURCE_DIR "/deploy/assets/details/landing.json"));
    terrain_ = std::make_shared<dem::DetailedTerrain>(plain_, detail_);
    ground_m_ = terrain_->height(kLat_deg, kLon_deg, {}).height_m;
  }
  static void TearDownTestSuite() {
    terrain_.reset();
    plain_.reset();
    delete folder_;
  }

  // Returns the pose of a camera that looks north, `tilt_deg` from the nadir.
  static Pose looking_north(double above_m, double tilt_deg, double north_m = 0) {
    const double lat_deg = kLat_deg + north_m / kMoonRadius_m * 180 / std::numbers::pi;
    const EastNorthUp axes = local_axes(lat_deg, kLon_deg);
    const double tilt = tilt_deg * std::numbers::pi / 180;
    const Vec3 z = axes.north * std::sin(tilt) - axes.up * std::cos(tilt);
    return {to_cartesian({lat_deg, kLon_deg, ground_m_ + above_m}),
            Quat(Mat3::from_rows(axes.east, z.cross(axes.east), z))};
  }

  // Selects for a square image 60 degrees wide.
  static Selection select(double above_m, double tilt_deg, int side_px, double sun_deg, double north_m = 0) {
    const View view(test::square_camera(side_px, 60), looking_north(above_m, tilt_deg, north_m));
    const Sun sun{sun_direction(local_axes(kLat_deg, kLon_deg), 270, sun_deg)};
    return select_for_view(*terrain_, view, &sun, {}, {});
  }

  static test::TemporaryFolder* folder_;
  static std::shared_ptr<dem::PyramidTerrain> plain_;
  static std::shared_ptr<const dem::Detail> detail_;
  static std::shared_ptr<dem::DetailedTerrain> terrain_;
  static double ground_m_;
};
test::TemporaryFolder* NearGround::folder_ = nullptr;
std::shared_ptr<dem::PyramidTerrain> NearGround::plain_;
std::shared_ptr<const dem::Detail> NearGround::detail_;
std::shared_ptr<dem::DetailedTerrain> NearGround::terrain_;
double NearGround::ground_m_ = 0;

// With a budget in proportion to the pixels, 512 x 512 pixels had less detail than 256 x 256.
TEST_F(NearGround, LimitsDoNotDependOnTheImageSize) {
  for (const int side_px : {256, 384, 512, 640, 1024}) {
    const Selection s = select(1.6, 78, side_px, 25);
    EXPECT_EQ(s.detail_limit_px, Accuracy::kDefaultDetailError_px) << side_px;
    EXPECT_EQ(s.shadow_limit_px, Accuracy::kDefaultShadowError_px) << side_px;
  }
}

TEST_F(NearGround, LimitsDoNotSwitchWhileTheCameraMoves) {
  constexpr int kSide_px = 512;
  constexpr double kSun_deg = 12, kStep_m = 0.1;
  for (int frame = 0; frame < 8; ++frame) {
    const double descended_m = 30 * std::pow(0.7, frame);
    for (const Selection& s :
         {select(1.6, 70, kSide_px, kSun_deg, frame * kStep_m), select(descended_m, 60, kSide_px, kSun_deg)}) {
      EXPECT_EQ(s.detail_limit_px, Accuracy::kDefaultDetailError_px) << frame;
      EXPECT_EQ(s.shadow_limit_px, Accuracy::kDefaultShadowError_px) << frame;
    }
  }
}

// Blocks of the finest ground, all nearer than the near border of the guard band, counted as behind the camera.
TEST_F(NearGround, IsDrawnAsTracedDownToAMillimetre) {
  const Renderer renderer(plain_, {});
  for (const double above_m : {0.015, 0.004, 0.001})
    for (const double tilt_deg : {0.0, 60.0, 85.0}) {
      FrameRequest request;
      request.camera = test::square_camera(64, 60);
      request.pose = looking_north(above_m, tilt_deg);
      request.detail = detail_;
      request.products = kDepth;
      request.visibility = Visibility::raytrace;
      const std::vector<double> traced = renderer.render(request).products.depth;
      request.visibility = Visibility::zbuffer;
      const std::vector<double> drawn = renderer.render(request).products.depth;
      int hits = 0, differ = 0;
      for (std::size_t i = 0; i < traced.size(); ++i) {
        hits += std::isnan(traced[i]) ? 0 : 1;
        differ += std::isnan(traced[i]) ? !std::isnan(drawn[i]) : !(std::abs(drawn[i] / traced[i] - 1) < 1e-3);
      }
      EXPECT_GT(hits, 64 * 64 / 4) << above_m << ' ' << tilt_deg;
      EXPECT_LE(differ, 64 * 64 / 100) << above_m << ' ' << tilt_deg;
    }
}

// Rounding of positions put some of them above the ground, where they saw nothing.
TEST_F(NearGround, ACameraOnTheGroundIsRefused) {
  for (int i = 0; i < 200; ++i) {
    const double lat_deg = kLat_deg + 1e-3 * i, height_m = terrain_->height(lat_deg, kLon_deg, {}).height_m;
    EXPECT_THROW(refuse_buried(*terrain_, to_cartesian({lat_deg, kLon_deg, height_m}), "the camera", ""),
                 ImpossibleRequest);
    EXPECT_NO_THROW(refuse_buried(*terrain_, to_cartesian({lat_deg, kLon_deg, height_m + 1e-4}), "the camera", ""));
  }
}

}  // namespace
}  // namespace selenograph::engine
