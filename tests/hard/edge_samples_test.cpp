// Samples at edges: each pixel is what it is without them, or the mean of its quarters; and edges are nearer the truth.
#include "engine/visibility/image/edge_samples.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "engine/verify/accuracy_scenes.h"
#include "engine/visibility/image/dense_samples.h"
#include "tests/support/effort.h"
#include "tests/support/hard_views.h"
#include "tests/support/same_bytes.h"
#include "tests/support/sample_scenery.h"

namespace selenograph::test {
namespace {

constexpr int kEdgeSide = 160;

class EdgeSamplesTest : public SampleScenery {
 protected:
  static engine::FrameRequest request(double tilt_deg, double disc_deg, const engine::Distortion& lens) {
    const Vec3 from = to_cartesian({-10, 44, 20000});
    engine::FrameRequest request = square_view(engine::tilted_pose(from, tilt_deg), kEdgeSide, 50,
                                               engine::sun_direction(local_axes(from), 100, 12));
    request.camera.distortion = lens;
    request.sun.angular_radius_deg = disc_deg;
    request.accuracy.max_error_px = 0.5;
    request.products = engine::kRadiance;
    return request;
  }

  static std::vector<float> radiance(engine::FrameRequest request, engine::Visibility visibility, int samples = 1,
                                     int at_edges = 1) {
    request.visibility = visibility;
    request.accuracy.samples_per_pixel = samples, request.accuracy.edge_samples = at_edges;
    return scenery().renderer->render(request).products.radiance;
  }

  // Whether a pixel has a neighbour of other radiance; written anew.
  static bool at_edge(const std::vector<float>& radiance, int x, int y) {
    const auto at = [&](int column, int row) {
      return static_cast<double>(radiance[static_cast<std::size_t>(row * kEdgeSide + column)]);
    };
    for (const auto& [dx, dy] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
      if (x + dx < 0 || x + dx >= kEdgeSide || y + dy < 0 || y + dy >= kEdgeSide) continue;
      const double own = at(x, y), other = at(x + dx, y + dy);
      if (own < 0.75 * other || other < 0.75 * own) return true;
    }
    return false;
  }
};

// Through lenses, before a disc, seen obliquely with the horizon in view; by either algorithm.
TEST_F(EdgeSamplesTest, PixelsAtEdgesAreTheMeanOfTheirQuarters) {
  struct Case {
    const char* name;
    double tilt_deg, disc_deg;
    engine::Distortion lens;
  };
  for (const engine::Visibility by : {engine::Visibility::raytrace, engine::Visibility::zbuffer})
    for (const Case& c : {Case{"nadir", 0, 0, {}},
                          {"limb", 75, 0, {}},
                          {"disc", 0, 0.27, {}},
                          {"lens", 0, 0, {-0.3, 0.1, -0.01, 0, 0}}}) {
      const engine::FrameRequest asked = request(c.tilt_deg, c.disc_deg, c.lens);
      const std::vector<float> plain = radiance(asked, by), edges = radiance(asked, by, 1, 4);
      engine::FrameRequest quarters = asked;
      quarters.camera = engine::dense_camera(asked.camera);
      quarters.accuracy.max_error_px = 2 * asked.accuracy.max_error_px;
      quarters.accuracy.max_shadow_error_px = 2 * engine::Accuracy::kDefaultShadowError_px;
      const std::vector<float> dense = radiance(quarters, by);
      const float largest = *std::max_element(plain.begin(), plain.end());
      std::size_t at_edges = 0, other = 0;
      for (int y = 0; y < kEdgeSide; ++y)
        for (int x = 0; x < kEdgeSide; ++x) {
          const auto pixel = static_cast<std::size_t>(y * kEdgeSide + x),
                     first = static_cast<std::size_t>(4 * y * kEdgeSide + 2 * x);
          if (!at_edge(plain, x, y)) {
            ASSERT_EQ(edges[pixel], plain[pixel]) << c.name << ' ' << x << ' ' << y;
            continue;
          }
          ++at_edges;
          const float mean =
              (dense[first] + dense[first + 1] + dense[first + 2 * kEdgeSide] + dense[first + 2 * kEdgeSide + 1]) / 4;
          other += !(std::abs(edges[pixel] - mean) <= 1e-5F * largest);
        }
      fmt::print("{} {}: {} of {} pixels are at edges, {} of them are not the mean of four pixels\n",
                 static_cast<int>(by), c.name, at_edges, plain.size(), other);
      EXPECT_GT(at_edges, 200U) << c.name;
      EXPECT_LT(at_edges * 2, plain.size()) << c.name;
      EXPECT_LE(other * 200, at_edges) << c.name;
    }
}

// Four samples and four at edges come near sixteen samples.
TEST_F(EdgeSamplesTest, HalveTheErrorAtEdges) {
  for (const engine::Visibility by : {engine::Visibility::raytrace, engine::Visibility::zbuffer})
    for (const double tilt_deg : {0.0, 60.0, 75.0}) {
      engine::FrameRequest asked = request(tilt_deg, 0, {});
      asked.accuracy.max_error_px = 0.125;
      const std::vector<float> truth = radiance(asked, by, full_effort() ? 256 : 100);
      const auto error = [&](const std::vector<float>& radiance) {
        double sum = 0, squares = 0;
        for (std::size_t i = 0; i < truth.size(); ++i)
          sum += static_cast<double>(truth[i]), squares += std::pow(static_cast<double>(radiance[i] - truth[i]), 2);
        return std::sqrt(squares * static_cast<double>(truth.size())) / sum;
      };
      const double one = error(radiance(asked, by)), one_edges = error(radiance(asked, by, 1, 4)),
                   four = error(radiance(asked, by, 4)), four_edges = error(radiance(asked, by, 4, 4)),
                   sixteen = error(radiance(asked, by, 16));
      fmt::print("{} tilt {}: 1 sample {:.4f}, with edges {:.4f}; 4 {:.4f}, {:.4f}; 16 {:.4f}\n", static_cast<int>(by),
                 tilt_deg, one, one_edges, four, four_edges, sixteen);
      EXPECT_LT(one_edges, 0.65 * one);
      EXPECT_LT(four_edges, 0.6 * four);
      EXPECT_LT(four_edges, 1.5 * sixteen);
    }
}

// The other products are of the pixels' centres, and the same; whatever the image's edge cuts.
TEST_F(EdgeSamplesTest, DoNotChangeOtherProducts) {
  engine::FrameRequest asked = request(0, 0, {});
  asked.camera.width = 129, asked.camera.height = 67;
  asked.products = engine::kRadiance | engine::kLit | engine::kDepth;
  asked.visibility = engine::Visibility::zbuffer;
  const engine::Frame plain = scenery().renderer->render(asked);
  for (const int samples : {1, 4}) {
    asked.accuracy.samples_per_pixel = samples, asked.accuracy.edge_samples = 4;
    const engine::Frame edges = scenery().renderer->render(asked);
    engine::FrameProducts others = edges.products, plain_others = plain.products;
    others.radiance = plain_others.radiance = {};
    EXPECT_TRUE(same_bytes(others, plain_others));
    EXPECT_NE(edges.products.radiance, plain.products.radiance);
    // And alone, radiance is what it is beside them.
    engine::FrameRequest alone = asked;
    alone.products = engine::kRadiance;
    EXPECT_EQ(scenery().renderer->render(alone).products.radiance, edges.products.radiance);
  }
}

}  // namespace
}  // namespace selenograph::test
