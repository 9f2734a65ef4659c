// The Sun's disc behind a straight edge: the share of it that is above, in closed form. (Both ways to see against 32
// rays a pixel are two_ways_test.)
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/hard_views.h"
#include "tests/support/shared_data.h"

namespace selenograph::test {
namespace {

constexpr double kPi = std::numbers::pi;

// Of a disc whose centre lies h radii above a straight edge. With brightness 1 - u (1 - mu) what a chord at height y
// holds is (1 - u) 2 sqrt(1 - y^2) + u pi / 2 (1 - y^2), integrated from -h to 1 and over all of pi (1 - u / 3).
double share_above(double h, double u) {
  if (std::abs(h) >= 1) return h > 0 ? 1 : 0;
  const double even = kPi - (std::acos(h) - h * std::sqrt(1 - h * h)), dome = kPi / 2 * (2.0 / 3 + h - h * h * h / 3);
  return ((1 - u) * even + u * dome) / (kPi * (1 - u / 3));
}

// A plateau 3 km high that ends along the meridian of 30 degrees, level ground east of it, the Sun in the west.
TEST(Penumbra, FramesBehindAStraightEdgeFollowTheClosedForm) {
  constexpr double kHeight_m = 3000, kElevation_deg = 20;
  TemporaryFolder folder;
  write_float_tile(folder.path(), "edge", {0.5, 29.5, 256, 257, 257},
                   [](double, double lon) { return lon <= 30 + 1e-9 ? kHeight_m : 0.0; });
  const engine::Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{});
  for (const auto& [radius_deg, darkening] : {std::pair{0.2666, 0.0}, {1.0, 0.0}, {0.2666, 0.6}, {1.0, 1.0}}) {
    const double shadow_deg = kHeight_m / std::tan(kElevation_deg * kDegree) / kMoonRadius_m / kDegree;
    const Geographic middle{0.01, 30 + shadow_deg, 0};
    engine::FrameRequest request = nadir_view({middle.lat_deg, middle.lon_deg, 6000}, 256, 12,
                                              local_direction(to_cartesian(middle), 270, kElevation_deg));
    request.sun.angular_radius_deg = radius_deg, request.sun.limb_darkening = darkening;
    const engine::FrameProducts p = renderer.render(request).products;
    double worst = 0, sum = 0;
    std::size_t partly = 0;
    for (std::size_t i = 0; i < p.lit.size(); ++i) {
      const Vec3 point(p.position[3 * i], p.position[3 * i + 1], p.position[3 * i + 2]);
      const Vec3 edge = to_cartesian({to_geographic(point).lat_deg, 30, kHeight_m}), to_edge = edge - point;
      // The plane of eye and edge; the Sun's distance from it.
      Vec3 normal = to_edge.cross(local_axes(edge).north).normalized();
      if (normal.dot(point) < 0) normal = -normal;
      const double above = std::asin(normal.dot(request.sun.direction)) / (radius_deg * kDegree);
      const double error = std::abs(static_cast<double>(p.lit[i]) - share_above(above, darkening));
      worst = std::max(worst, error);
      if (std::abs(above) < 1) sum += error, ++partly;
    }
    fmt::print(
        "radius {} degrees, limb darkening {}: {} pixels in the penumbra, off by {:.4f} of the disc on average, {:.4f} "
        "at worst\n",
        radius_deg, darkening, partly, sum / static_cast<double>(partly), worst);
    EXPECT_GT(partly, 5000U);
    EXPECT_LT(sum / static_cast<double>(partly), 0.02);
    EXPECT_LT(worst, 0.065);  // 32 samples of the disc: one is 0.031
  }
}

}  // namespace
}  // namespace selenograph::test
