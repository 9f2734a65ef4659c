// Craters that a frame lists: against those of the region, projected by the camera one by one.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>

#include "dem/base/error.h"
#include "dem/detail/detail.h"
#include "dem/detail/features.h"
#include "engine/cache/render_context.h"
#include "engine/camera/view.h"
#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

using std::numbers::pi;

class CratersInFrames : public testing::Test {
 protected:
  static constexpr double kLat = 10.25, kLon = 20.25;

  CratersInFrames() {
    test::write_float_tile(folder_.path(), "hill", {10.5, 20, 128, 65, 65}, [](double lat, double lon) {
      return 100 + 30 * std::sin(900 * lat) + 20 * std::cos(1100 * lon);
    });
    dem::DetailPreset preset;
    preset.craters.seed = 3;
    preset.craters.smallest_m = 16, preset.craters.largest_m = 256;
    detail_ = std::make_shared<const dem::Detail>(preset);
    renderer_ =
        std::make_unique<Renderer>(test::open_terrain(folder_.path()), RendererOptions{2, std::size_t{256} << 20});
  }

  // From 3 km above the ground, with the finest mesh.
  FrameRequest request(double north_of_down) const {
    FrameRequest request;
    request.camera = test::square_camera(256, 40);
    const double ground_m = renderer_->terrain_with(detail_)->height(kLat, kLon).height_m;
    const Vec3 place = to_cartesian({kLat, kLon, ground_m + 3000});
    const EastNorthUp axes = local_axes(place);
    request.pose = test::looking(place, -axes.up + north_of_down * axes.north, axes.north + 0.2 * axes.east);
    request.sun.direction = test::local_sun(kLat, kLon, 80, 20);
    request.detail = detail_;
    request.accuracy.max_error_px = 0;
    request.craters = RimOptions{6, 0.03};
    return request;
  }

  // The rim of a crater as it is on the finest surface.
  std::vector<RimPoint> projected(const dem::CraterFeature& crater, std::size_t points, const View& view) const {
    const auto terrain = renderer_->terrain_with(detail_);
    std::vector<RimPoint> outline;
    for (std::size_t i = 0; i < points; ++i) {
      const Vec3 on =
          dem::CraterSurvey::on_rim(crater.crater, 2 * pi * static_cast<double>(i) / static_cast<double>(points));
      const Geographic g = to_geographic(on * kMoonRadius_m);
      const auto pixel = view.project(on * (kMoonRadius_m + terrain->height(g.lat_deg, g.lon_deg).height_m));
      outline.push_back(pixel ? RimPoint{pixel->x, pixel->y} : RimPoint{1e9, 1e9});
    }
    return outline;
  }

  static double share_inside(const std::vector<RimPoint>& outline) {
    const auto inside = std::count_if(outline.begin(), outline.end(), [](const RimPoint& p) {
      return p.x_px >= -0.5 && p.y_px >= -0.5 && p.x_px < 255.5 && p.y_px < 255.5;
    });
    return static_cast<double>(inside) / static_cast<double>(outline.size());
  }

  std::vector<dem::CraterFeature> around() const {
    return renderer_->query(detail_, {}, [&](const RenderContext& context) {
      const dem::CraterSurvey survey(context.terrain, context.cache.roughness(context.terrain, {}));
      return survey.craters_in({kLat - 0.09, kLat + 0.09, kLon - 0.09, kLon + 0.09}, 16, 0.03, {});
    });
  }

  test::TemporaryFolder folder_;
  std::shared_ptr<const dem::Detail> detail_;
  std::unique_ptr<Renderer> renderer_;
};

TEST_F(CratersInFrames, AreThoseOfTheRegionProjected) {
  const std::vector<dem::CraterFeature> expected = around();
  for (const double slant : {0.0, 0.3}) {
    const FrameRequest asked = request(slant);
    const CraterRims listed = renderer_->render(asked).report.craters;
    EXPECT_EQ(listed.cut_off, 0U);
    std::map<std::uint64_t, const CraterRim*> found;
    for (const CraterRim& rim : listed.rims) found.emplace(rim.feature.crater.id, &rim);
    ASSERT_EQ(found.size(), listed.rims.size());
    const View view(asked.camera, asked.pose);
    int checked = 0;
    for (const dem::CraterFeature& crater : expected) {
      const auto mine = found.find(crater.crater.id);
      const auto outline = projected(crater, mine == found.end() ? 48 : mine->second->outline.size(), view);
      const RimEllipse ellipse = ellipse_of(outline);
      if (mine == found.end()) {
        // Outside, or too small; the ground rises before nothing much.
        EXPECT_TRUE(share_inside(outline) < 0.1 || ellipse.semi_major_px * ellipse.semi_minor_px < 9.3)
            << crater.crater.diameter_m << ' ' << ellipse.centre.x_px << ' ' << ellipse.centre.y_px;
        continue;
      }
      const CraterRim& rim = *mine->second;
      EXPECT_EQ(rim.feature.visibility, crater.visibility);
      EXPECT_EQ(rim.feature.depth_m, crater.depth_m);
      for (std::size_t i = 0; i < outline.size(); ++i) {
        EXPECT_NEAR(rim.outline[i].x_px, outline[i].x_px, 0.01);
        EXPECT_NEAR(rim.outline[i].y_px, outline[i].y_px, 0.01);
      }
      EXPECT_LE(rim.rim_visible, share_inside(outline) + 1e-9);
      EXPECT_GE(rim.rim_visible, share_inside(outline) - 0.2);
      found.erase(mine);
      ++checked;
    }
    EXPECT_TRUE(found.empty()) << found.size();
    EXPECT_GT(checked, 12);
  }
}

TEST_F(CratersInFrames, ChangeNoPixel) {
  for (const bool thinned : {false, true})
    for (const int samples : {1, 4}) {
      FrameRequest with = request(0.3);
      with.accuracy = {};
      with.accuracy.samples_per_pixel = samples;
      with.products = kRadiance | kPosition | kSource;
      if (thinned) with.truth = TruthGrid{10, 20, 101, 77, 3};
      FrameRequest without = with;
      without.craters.reset();
      const Frame a = renderer_->render(with), b = renderer_->render(without);
      EXPECT_GT(a.report.craters.rims.size(), 12U);
      EXPECT_TRUE(b.report.craters.rims.empty());
      EXPECT_EQ(a.products.radiance, b.products.radiance);
      EXPECT_EQ(a.products.source, b.products.source);
      EXPECT_TRUE(a.products.range.empty());
      ASSERT_EQ(a.products.position.size(), b.products.position.size());
      for (std::size_t i = 0; i < a.products.position.size(); ++i)
        ASSERT_TRUE(a.products.position[i] == b.products.position[i] || std::isnan(b.products.position[i])) << i;
    }
}

// One that the mesh is too coarse to show labels nothing.
TEST_F(CratersInFrames, AreOnlyThoseOfTheMesh) {
  FrameRequest fine = request(0), coarse = fine;
  coarse.accuracy.max_error_px = coarse.accuracy.max_detail_error_px = 20;
  const auto smallest = [&](const FrameRequest& asked) {
    double least_m = 1e9;
    for (const CraterRim& rim : renderer_->render(asked).report.craters.rims)
      least_m = std::min(least_m, rim.feature.crater.diameter_m);
    return least_m;
  };
  EXPECT_LT(smallest(fine), 64);
  EXPECT_GE(smallest(coarse), 64);
}

TEST(RimEllipse, IsThatOfACircleFromAfar) {
  for (const double turn : {0.0, 0.7, 1.5, -1.2}) {
    std::vector<RimPoint> outline;
    for (int i = 0; i < 24; ++i) {
      const double x = 20 * std::cos(2 * pi * i / 24), y = 7 * std::sin(2 * pi * i / 24);
      outline.push_back({100 + x * std::cos(turn) - y * std::sin(turn), 50 + x * std::sin(turn) + y * std::cos(turn)});
    }
    const RimEllipse ellipse = ellipse_of(outline);
    EXPECT_NEAR(ellipse.centre.x_px, 100, 1e-9);
    EXPECT_NEAR(ellipse.centre.y_px, 50, 1e-9);
    EXPECT_NEAR(ellipse.semi_major_px, 20, 1e-9);
    EXPECT_NEAR(ellipse.semi_minor_px, 7, 1e-9);
    EXPECT_NEAR(ellipse.angle_deg, turn * kDegreesPerRadian, 1e-9);
  }
}

}  // namespace
}  // namespace selenograph::engine
