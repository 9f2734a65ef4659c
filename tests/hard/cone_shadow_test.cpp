// The shadow of one cone on a smooth Moon: its tip has a closed form, up to two hundred kilometres away.
//
// A Sun ray that grazes the apex (radius R + h) and meets the sphere where the Sun stands e above the horizon has run
//   t = sqrt(R^2 sin^2 e + 2 R h + h^2) - R sin e
// from apex to tip: |T + t s| = R + h with T.s = R sin e. Elevations are those at the tip. (At the cone the Sun stands
// higher, by the angle between the two places: for 5 km and 0.05 degrees that is 4.3 degrees. Were it 0.05 degrees
// there, the shadow would pass over the horizon and end nowhere.)
//
// The camera hangs over the tip; the cone is far outside the view and on a tile of its own. The image's middle row lies
// in the plane of Sun, apex and centre, so that its pixels see the very axis of the shadow, which ends in a point.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "dem/terrain/terrain.h"
#include "engine/renderer.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

constexpr double kLat = 10, kLon = 30;  // of the apex, a post
constexpr double kBase_deg = 0.4;       // radius of the cone's base: 12 km
constexpr int kWidth = 161, kHeight = 17, kMiddleRow = kHeight / 2, kTip = kWidth / 2;  // pixels
constexpr double kElevations_deg[] = {0.05, 0.5, 2};
constexpr engine::Accuracy kFinest{.max_error_px = 0};

struct Shadow {
  Vec3 apex, sun, tip;
  double length_m = 0;
};

Shadow shadow_of(double height_m, double elevation_deg, double azimuth_deg) {
  const double rise = kMoonRadius_m * std::sin(elevation_deg * kDegree);
  const double at_apex = std::sqrt(rise * rise + 2 * kMoonRadius_m * height_m + height_m * height_m);
  Shadow s;
  s.apex = to_cartesian({kLat, kLon, height_m});
  s.sun = local_sun(kLat, kLon, azimuth_deg, std::asin(at_apex / (kMoonRadius_m + height_m)) / kDegree).normalized();
  s.length_m = at_apex - rise;
  s.tip = s.apex - s.length_m * s.sun;
  return s;
}

engine::FrameRequest over_the_tip(const Shadow& s, double pixel_m) {
  const double altitude_m = 1000 * pixel_m;
  engine::FrameRequest q = blank_request();
  q.camera = {kWidth, kHeight, altitude_m / pixel_m, altitude_m / pixel_m, kTip, kMiddleRow, {}};
  // Image right: away from the Sun.
  const Vec3 up = s.tip.normalized(), across = up.cross(s.sun).normalized();
  q.pose = looking(s.tip + altitude_m * up, -up, -across);
  q.sun.direction = s.sun;
  q.products = engine::kLit | engine::kPosition | engine::kGsd;
  return q;
}

// Pixels along the axis by which the shadow is too long or too short, and dark ones beside the axis beyond the tip.
struct Tip {
  int judged = 0, too_long = 0, too_short = 0, strangers = 0;
  double promised_px = 0;
};

Tip measure(const Shadow& s, const engine::FrameProducts& p) {
  Tip tip;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const auto at = static_cast<std::size_t>(y * kWidth + x);
      // Within one post of the terminator facets may face the other way (smooth_sphere_test.cpp).
      if (at3(p.position, at).dot(s.sun) < 1.1 * static_cast<double>(p.gsd[at])) continue;
      const bool dark = p.lit[at] == 0;
      tip.judged += y == kMiddleRow;
      if (y != kMiddleRow)
        tip.strangers += dark && x > kTip;
      else if (dark)
        tip.too_long = std::max(tip.too_long, x - kTip);
      else
        tip.too_short = std::max(tip.too_short, kTip - x);
    }
  return tip;
}

class ConeShadow : public ::testing::TestWithParam<double> {
 protected:
  ConeShadow() {
    write_global_tile(folder_.path(), 1, [](double, double) { return 0.0; });
    write_float_tile(folder_.path(), "cone", {kLat + 0.5, kLon - 0.5, 256, 257, 257}, [&](double lat, double lon) {
      const double off = std::hypot(lat - kLat, (lon - kLon) * std::cos(kLat * kDegree));
      return std::max(0.0, height_m() * (1 - off / kBase_deg));
    });
    renderer_ = std::make_unique<engine::Renderer>(open_terrain(folder_.path()),
                                                   engine::RendererOptions{1, std::size_t{512} << 20});
  }
  static double height_m() { return GetParam(); }

  Tip tip_of(double elevation_deg, double pixel_m, const engine::Accuracy& accuracy) const {
    const Shadow s = shadow_of(height_m(), elevation_deg, 250);
    engine::FrameRequest q = over_the_tip(s, pixel_m);
    q.accuracy = accuracy;
    const engine::Frame frame = renderer_->render(q);
    EXPECT_EQ(frame.report.hit_fraction, 1);
    for (const auto& source : frame.report.sources) EXPECT_EQ(source.name, "global") << "the cone is in view";
    Tip tip = measure(s, frame.products);
    tip.promised_px = frame.report.shadow_error_px;
    fmt::print("{:9.0f} {:8} {:9.1f} {:8} {:12} {:12.3g} {:12} {:9} {:10} {:7}\n", height_m(), elevation_deg,
               s.length_m / 1000, pixel_m, accuracy.max_error_px, tip.promised_px, tip.too_long, tip.too_short,
               tip.strangers, tip.judged);
    return tip;
  }
  static void print_head() {
    fmt::print("{:>9} {:>8} {:>9} {:>8} {:>12} {:>12} {:>12} {:>9} {:>10} {:>7}\n", "cone m", "Sun deg", "length km",
               "m/pixel", "max_error_px", "promised px", "too long px", "too short", "strangers", "judged");
  }

 private:
  TemporaryFolder folder_;
  std::unique_ptr<engine::Renderer> renderer_;
};

TEST_P(ConeShadow, TipIsWhereTheGrazingRayMeetsTheSphere) {
  print_head();
  for (const double elevation : kElevations_deg) {
    const Shadow s = shadow_of(height_m(), elevation, 250);
    ASSERT_NEAR(s.tip.norm(), kMoonRadius_m, 1e-6);
    ASSERT_NEAR(s.tip.dot(s.sun), kMoonRadius_m * std::sin(elevation * kDegree), 1e-6);
    for (const double pixel_m : {50.0, 20.0}) {
      const Tip tip = tip_of(elevation, pixel_m, kFinest);
      EXPECT_LE(tip.too_long, 1);
      EXPECT_LE(tip.too_short, 1);
      EXPECT_EQ(tip.strangers, 0);
      EXPECT_GT(tip.judged, kTip) << "the tip is in view";
    }
    // Finer than is asked for, to see what there is: float holds an apex 200 km from the anchor to 16 mm, the facets
    // lie up to 2 mm beneath the sphere, and heights count over tan(e).
    const Tip tip = tip_of(elevation, 2, kFinest);
    EXPECT_LE(2 * std::max(tip.too_long, tip.too_short), 2 + 0.018 / std::tan(elevation * kDegree));
  }
}

// With the default settings the shadow's edge is where the frame promises it to be.
TEST_P(ConeShadow, TipIsWithinWhatTheDefaultsPromise) {
  print_head();
  for (const double elevation : kElevations_deg)
    for (const double pixel_m : {50.0, 20.0}) {
      const Tip tip = tip_of(elevation, pixel_m, engine::Accuracy{});
      EXPECT_LE(std::max(tip.too_long, tip.too_short), 1 + tip.promised_px);
      EXPECT_EQ(tip.strangers, 0);
    }
}

std::vector<double> heights_m() {
  if (full_effort()) return {1000, 5000, 10000};
  return {5000};
}
INSTANTIATE_TEST_SUITE_P(OfHeight, ConeShadow, ::testing::ValuesIn(heights_m()));

}  // namespace
}  // namespace selenograph::test
