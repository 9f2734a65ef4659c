// Shadows of a mountain on level ground, seen from 60 km with coarser terrain and with all of it: edges lie within what
// the frame promises (shadow_error_px), and pixels within that and the pixel grid's diagonal.
//
// The bound is of the edge itself. A pixel says what its centre is, so an edge that is read from pixels lies up to half
// a pixel's diagonal beside where it is, in either frame. The same mesh with pixels of an eighth shows that no more
// than this is missing.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <utility>

#include "engine/renderer.h"
#include "engine/verify/error_measures.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

constexpr double kPeakLat = 10, kPeakLon = 30, kAltitude_m = 60e3, kRadius_deg = 0.1;  // of the mountain: 3 km
constexpr int kShadowSide = 128;
constexpr double kPixel_m = 80;

// Of 1 km, with ribs that coarse posts round off.
double mountain(double lat_deg, double lon_deg) {
  const double north = lat_deg - kPeakLat, east = (lon_deg - kPeakLon) * std::cos(kPeakLat * kDegree);
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

// Pixels `finer` times as small, of about the same terrain: its aims are of so many more of them. The shadow's tip is
// in the middle, west of the peak.
engine::FrameRequest over_the_tip(double elevation_deg, int finer, double aim_px) {
  const int side = finer > 1 ? 2 * kShadowSide : kShadowSide;
  const double focal_px = finer * kAltitude_m / kPixel_m, middle = (side - 1) / 2.0,
               west_deg = 0.9 * 1000 / std::tan(elevation_deg * kDegree) / kMetresPerDegree;
  const Vec3 from = to_cartesian({kPeakLat, kPeakLon - west_deg, kAltitude_m});
  engine::FrameRequest q = blank_request();
  q.camera = {side, side, focal_px, focal_px, middle, middle, {}};
  q.pose = looking(from, -from, local_axes(from).north);
  q.sun.direction = local_sun(kPeakLat, kPeakLon, 90, elevation_deg);
  q.products = engine::kLit | engine::kPosition;
  q.accuracy = {.max_error_px = 1.0 * finer, .max_shadow_error_px = aim_px * finer};
  return q;
}

TEST(ShadowEdges, AreWithinTheirBoundAndThePixelGrid) {
  const TemporaryFolder folder;
  write_global_tile(folder.path(), 1, [](double, double) { return 0.0; });
  write_float_tile(folder.path(), "mountain", {kPeakLat + 0.125, kPeakLon - 0.125, 1024, 257, 257}, mountain);
  const engine::Renderer renderer(open_terrain(folder.path()), engine::RendererOptions{2, std::size_t{512} << 20});
  fmt::print("{:>8} {:>14} {:>9} {:>9} {:>7}\n", "Sun deg", "of each pixel", "bound px", "worst px", "unlike");
  for (const auto& [elevation_deg, aim_px] :
       {std::pair{4.0, 16.0}, {8.0, 16.0}, {15.0, 16.0}, {6.0, 4.0}, {8.0, 4.0}, {12.0, 2.0}, {15.0, 2.0}})
    for (const int finer : {1, 8}) {
      engine::FrameRequest q = over_the_tip(elevation_deg, finer, aim_px);
      const engine::Frame frame = renderer.render(q);
      q.accuracy = {.max_error_px = 0};
      const Displacement d = displacement(frame.products, renderer.render(q).products, q.camera.width);
      const double bound_px = frame.report.shadow_error_px;
      fmt::print("{:8} {:14} {:9.3f} {:9.3f} {:7}\n", elevation_deg, 1.0 / finer, bound_px / finer, d.worst_px / finer,
                 d.unlike);
      EXPECT_LE(d.worst_px, bound_px + std::numbers::sqrt2) << elevation_deg << " degrees, 1 / " << finer;
      EXPECT_LE(bound_px, aim_px * finer);
      if (bound_px > 2 * finer) {
        EXPECT_GT(d.unlike, 0) << "nothing was displaced";
      }
    }
}

}  // namespace
}  // namespace selenograph::test
