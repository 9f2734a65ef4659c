// Shadows of a mountain on level ground, seen from 60 km with coarser terrain and with all of it: edges lie within what
// the frame promises (shadow_error_px), and pixels within that and the pixel grid's diagonal.
//
// The bound is of the edge itself. A pixel says what its centre is, so an edge that is read from pixels lies up to half
// a pixel's diagonal beside where it is, in either frame. The same mesh with pixels of an eighth shows that no more
// than this is missing.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "engine/renderer.h"
#include "engine/verify/error_measures.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

constexpr double kLat = 10, kLon = 30, kAltitude_m = 60e3, kRadius_deg = 0.1;  // of the mountain: 3 km
constexpr int kSide = 128;
constexpr double kPixel_m = 80;

// Of 1 km, with ribs that coarse posts round off.
double mountain(double lat_deg, double lon_deg) {
  const double north = lat_deg - kLat, east = (lon_deg - kLon) * std::cos(kLat * kDegree);
  const double r = std::hypot(north, east) / kRadius_deg;
  if (r >= 1) return 0;
  return (1 - r) * (1000 + 120 * r * std::sin(23 * std::atan2(north, east)) + 40 * std::sin(60 * r));
}

// Worst distance in pixels from a pixel of level ground to one that the reference has like it; how many are unlike.
struct Displacement {
  double worst_px = 0;
  int unlike = 0;
};

Displacement displacement(const engine::FrameProducts& frame, const engine::FrameProducts& reference, int side) {
  Displacement out;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const auto at = static_cast<std::size_t>(y * side + x);
      if (frame.lit[at] == reference.lit[at]) continue;
      if (at3(reference.position, at).norm() > kMoonRadius_m + 1) continue;
      ++out.unlike;
      // From centre to centre.
      const double away = engine::distance_to_flag(side, side, reference.lit, x, y, frame.lit[at] > 0) + 0.5;
      out.worst_px = std::max(out.worst_px, away);
    }
  return out;
}

TEST(ShadowEdges, AreWithinTheirBoundAndThePixelGrid) {
  const TemporaryFolder folder;
  write_global_tile(folder.path(), 1, [](double, double) { return 0.0; });
  write_float_tile(folder.path(), "mountain", {kLat + 0.125, kLon - 0.125, 1024, 257, 257}, mountain);
  const engine::Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{2, std::size_t{512} << 20});
  for (const double elevation_deg : {4.0, 8.0, 15.0})
    for (const int finer : {1, 8}) {
      // The tip of the shadow in the middle: 1 km / tan(e) west of the peak, which the Sun is east of.
      const double west_deg = 0.9 * 1000 / std::tan(elevation_deg * kDegree) / kMetresPerDegree;
      const Vec3 from = to_cartesian({kLat, kLon - west_deg, kAltitude_m});
      engine::FrameRequest q = blank_request();
      const double focal_px = kAltitude_m / kPixel_m * finer, middle = (finer * kSide / 4 - 1) / 2.0;
      const int side = finer == 1 ? kSide : finer * kSide / 4;
      q.camera = {side,
                  side,
                  focal_px,
                  focal_px,
                  finer == 1 ? (kSide - 1) / 2.0 : middle,
                  finer == 1 ? (kSide - 1) / 2.0 : middle,
                  {}};
      q.pose = looking(from, -from, local_axes(from).north);
      q.sun.direction = local_sun(kLat, kLon, 90, elevation_deg);
      q.products = engine::kLit | engine::kPosition;
      q.accuracy = {.max_error_px = 1.0 * finer, .max_shadow_error_px = 16.0 * finer};
      const engine::Frame frame = renderer.render(q);
      q.accuracy = {.max_error_px = 0};
      const Displacement d = displacement(frame.products, renderer.render(q).products, side);
      const double bound_px = frame.report.shadow_error_px;
      RecordProperty("bound_px", std::to_string(bound_px / finer));
      RecordProperty("worst_px", std::to_string(d.worst_px / finer));
      EXPECT_LE(d.worst_px, bound_px + std::numbers::sqrt2) << elevation_deg << " degrees, " << finer;
      EXPECT_GT(bound_px, 0.1 * finer);
      printf("Sun %g, %d: bound %.3f px, worst %.3f px of %d\n", elevation_deg, finer, bound_px / finer,
             d.worst_px / finer, d.unlike);
      EXPECT_GT(d.unlike, 0) << "nothing was displaced";
    }
}

}  // namespace
}  // namespace selenograph::test
