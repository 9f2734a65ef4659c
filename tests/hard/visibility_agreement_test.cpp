// The z-buffer against rays, pixel by pixel: the same points, the same shadows; where they differ on a shadow, the
// double-precision judge says who is right.
#include "dem/base/vector_targets.h"
// Highway's headers come after it: which sets of vectors they know depends on it.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "engine/camera/projection.h"
#include "engine/camera/sight_table.h"
#include "engine/verify/accuracy_scenes.h"
#include "engine/visibility/image/dense_samples.h"
#include "tests/support/hard_views.h"
#include "tests/support/same_bytes.h"
#include "tests/support/sample_scenery.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

constexpr int kSide = 384;
constexpr double kGrazingEnough_m = 0.02;

struct Disputes {
  std::size_t pixels = 0, points = 0, flags = 0, zbuffer_wrong = 0, rays_wrong = 0, grazing = 0;
  void add(const Disputes& o) {
    pixels += o.pixels, points += o.points, flags += o.flags;
    zbuffer_wrong += o.zbuffer_wrong, rays_wrong += o.rays_wrong, grazing += o.grazing;
  }
};

// Judged where the frames ask for the finest posts, which are the judge's.
Disputes compare_both_ways(const Scenery& scenery, const std::string& name, engine::FrameRequest request) {
  request.products = engine::kDepth | engine::kPosition | engine::kLit;
  request.visibility = engine::Visibility::raytrace;
  const engine::Frame rays = scenery.renderer->render(request);
  request.visibility = engine::Visibility::zbuffer;
  const engine::Frame drawn = scenery.renderer->render(request);
  EXPECT_EQ(rays.report.visibility, engine::Visibility::raytrace);
  EXPECT_EQ(drawn.report.visibility, engine::Visibility::zbuffer);
  EXPECT_GT(drawn.report.hit_fraction, 0.05) << name;
  EXPECT_EQ(rays.report.sources.size(), drawn.report.sources.size());
  Disputes d;
  const auto &a = rays.products, &b = drawn.products;
  d.pixels = a.depth.size();
  for (std::size_t i = 0; i < d.pixels; ++i) {
    const bool same = std::isnan(a.depth[i]) ? std::isnan(b.depth[i]) : std::abs(a.depth[i] - b.depth[i]) <= 0.01;
    d.points += !same;
    if (!same || std::isnan(a.depth[i]) || a.lit[i] == b.lit[i]) continue;
    ++d.flags;
    if (request.accuracy.max_error_px > 0) continue;
    const Vec3 eye = request.pose.position_m, direction = (at3(b.position, i) - eye).normalized();
    const FirstHit truth = scenery.judge->first_hit(eye, direction);
    if (truth.hit != Verdict::yes) continue;
    const Vec3 point = eye + truth.distance_m * direction;
    if (scenery.judge->grazes(point, truth.face, request.sun.direction, kGrazingEnough_m)) {
      ++d.grazing;
      continue;
    }
    const bool free = scenery.judge->sun_blocked(point, truth.face, request.sun.direction) == Verdict::no;
    d.zbuffer_wrong += free != (b.lit[i] > 0), d.rays_wrong += free != (a.lit[i] > 0);
  }
  fmt::print(
      "{:<28} {} pixels: {} points differ, {} shadow flags: {} within 2 cm of grazing, z-buffer wrong {}, rays {}\n",
      name, d.pixels, d.points, d.flags, d.grazing, d.zbuffer_wrong, d.rays_wrong);
  EXPECT_EQ(d.points, 0U) << name;
  EXPECT_LE(d.flags * 1000, d.pixels) << name;
  return d;
}

class TwoWays : public SampleScenery {
 protected:
  static Disputes compare(const std::string& name, const engine::FrameRequest& request) {
    return compare_both_ways(scenery(), name, request);
  }
};

TEST_F(TwoWays, ReferenceConfirmsBoth) {
  Disputes all;
  const Vec3 from = to_cartesian({-10, 44, 20000});
  for (const double elevation : {3.0, 15.0, 45.0})
    for (const double tilt : {0.0, 60.0}) {
      engine::FrameRequest request = square_view(engine::tilted_pose(from, tilt), kSide, tilt > 0 ? 25 : 50,
                                                 engine::sun_direction(local_axes(from), 115, elevation));
      all.add(compare(fmt::format("tilt {} deg, Sun {} deg", tilt, elevation), request));
    }
  EXPECT_LE(all.zbuffer_wrong * 100000, all.pixels);
  EXPECT_LE(all.rays_wrong * 100000, all.pixels);
}

// Returns a camera by its lines of sight at every 16th pixel or so.
engine::Camera by_lines_of_sight(const engine::Camera& camera) {
  const engine::Projection projection(camera);
  constexpr int kNodes = kSide / 16;
  std::vector<Vec3> directions;
  for (int j = 0; j < kNodes; ++j)
    for (int i = 0; i < kNodes; ++i)
      directions.push_back(
          projection.direction((camera.width - 1.0) * i / (kNodes - 1), (camera.height - 1.0) * j / (kNodes - 1))
              .value());
  engine::Camera table{camera.width, camera.height};
  set_sights(std::make_shared<engine::SightTable>("table", kNodes, kNodes, directions, "table.tif"), table);
  return table;
}

// Lenses of OpenCV's terms, as a table, and CAHVOR's vectors, CAHVORE up to 75 degrees from the boresight.
TEST_F(TwoWays, AgreeThroughCalibratedLenses) {
  const Vec3 from = to_cartesian({-10, 44, 20000});
  const Vec3 sun = engine::sun_direction(local_axes(from), 115, 15);
  engine::FrameRequest rational = square_view(engine::tilted_pose(from, 0), kSide, 50, sun);
  rational.camera.distortion = {0.9, 0.2, 0.01, 0.001, -0.002, 1.3, 0.45, 0.06, 0.003, -0.001, -0.002, 0.0005, 4, -7};
  compare("OpenCV's terms", rational);
  rational.camera = by_lines_of_sight(rational.camera);
  compare("lines of sight", rational);
  for (const auto& [linearity, focal_px] : {std::pair(1.0, 400.0), {0.0, 210.0}, {-1.0, 300.0}}) {
    engine::FrameRequest request = square_view(engine::tilted_pose(from, 30), kSide, 50, sun);
    const Vec3 a = Vec3(0.02, -0.03, 1).normalized();
    request.camera.cahvor = {a,
                             Vec3(focal_px, 1, 0) + 191 * a,
                             Vec3(-2, focal_px, 0) + 192 * a,
                             Vec3(-0.01, 0.02, 1).normalized(),
                             {0.01, -0.03, 0.005},
                             linearity};
    request.camera.fx = request.camera.cahvor->fx();
    request.camera.fy = request.camera.cahvor->fy();
    request.camera.cx = request.camera.cahvor->cx();
    request.camera.cy = request.camera.cahvor->cy();
    compare(fmt::format("CAHVORE, linearity {}", linearity), request);
  }
}

// At the foot of a slope that the sunlight nearly grazes, float rounds across the foot's edge in light space.
TEST(TwoWaysOverHadley, AreRightAtTheFootOfSlopes) {
  const std::string folder = shared_data("hadley");
  SELENOGRAPH_SKIP_WITHOUT(folder);
  const Scenery hadley(folder);
  const Geographic from{26.1322, 3.6339, 15000};
  const Disputes found = compare_both_ways(hadley, "Hadley, Sun 3 deg",
                                           nadir_view(from, 1024, 50, local_direction(to_cartesian(from), 270, 3)));
  EXPECT_EQ(found.zbuffer_wrong, 0U);
  EXPECT_EQ(found.rays_wrong, 0U);
}

// Beside the edge of the data rays look again where they find nothing, and mostly find nothing again: what the others
// of their packet see stays as it was.
TEST_F(TwoWays, AgreeOnNormalsWhereTheTerrainEndsAtTheLimb) {
  const auto& rasters = scenery().renderer->terrain().catalogue().rasters();
  const dem::Footprint& some = rasters.front().footprint;
  const Vec3 seen = to_cartesian({(some.south_deg + some.north_deg) / 2, (some.west_deg + some.east_deg) / 2, 0});
  std::size_t compared = 0, different = 0;
  for (const double aside_deg : {83.0, 84.0, 85.0}) {
    const Geographic place = to_geographic(seen);
    const Vec3 from = to_cartesian({place.lat_deg, place.lon_deg - aside_deg, 2e7});
    engine::FrameRequest request = square_view(looking(from, seen - from, local_axes(from).north), kSide, 0.15,
                                               engine::sun_direction(local_axes(seen), 100, 12));
    request.products = engine::kDepth | engine::kNormal;
    request.visibility = engine::Visibility::raytrace;
    const engine::FrameProducts rays = scenery().renderer->render(request).products;
    request.visibility = engine::Visibility::zbuffer;
    const engine::FrameProducts drawn = scenery().renderer->render(request).products;
    for (std::size_t i = 0; i < rays.depth.size(); ++i) {
      if (!(std::abs(rays.depth[i] - drawn.depth[i]) < 1e-6)) continue;
      ++compared;
      for (std::size_t k = 3 * i; k < 3 * i + 3; ++k)
        if (std::abs(rays.normal[k] - drawn.normal[k]) > 1e-5F) {
          ++different;
          break;
        }
    }
  }
  EXPECT_GT(compared, 1000U);
  EXPECT_EQ(different, 0U);
}

// Whatever vectors a machine has, down to none: every byte of every product.
TEST_F(TwoWays, EveryWidthOfVectorsGivesTheSameBytes) {
  const Vec3 from = to_cartesian({-10, 44, 20000});
  std::vector<engine::FrameRequest> requests;
  for (const double tilt : {0.0, 60.0})
    requests.push_back(square_view(engine::tilted_pose(from, tilt), 192, tilt > 0 ? 25 : 50,
                                   engine::sun_direction(local_axes(from), 115, 8)));
  requests.push_back(requests[1]);
  requests.back().camera.distortion = {-0.3, 0.1, -0.01, 0, 0};
  // Two metres above the ground, where triangles are clipped.
  const double ground_m = scenery().terrain->height(-10, 44).height_m;
  requests.push_back(square_view(engine::tilted_pose(to_cartesian({-10, 44, ground_m + 2}), 80), 192, 60,
                                 engine::sun_direction(local_axes(from), 115, 8)));
  const engine::ProductSet every_product = 2 * engine::kDetail - 1;
  std::vector<engine::FrameProducts> seen;
  for (engine::FrameRequest& r : requests) {
    r.products = every_product;
    r.accuracy.max_error_px = 1;
    r.visibility = engine::Visibility::raytrace;
    seen.push_back(scenery().renderer->render(r).products);
    r.visibility = engine::Visibility::zbuffer;
  }
  const std::size_t by_rays = requests.size();
  requests.push_back(requests[0]);  // these two without rays: they are slow
  requests.back().sun.angular_radius_deg = 0.2666;
  requests.push_back(requests[1]);
  requests.back().accuracy.samples_per_pixel = 4;
  requests.push_back(requests[0]);
  requests.back().visibility = engine::Visibility::raytrace;
  std::vector<engine::FrameProducts> first;
  const std::vector<std::int64_t> targets = hwy::SupportedAndGeneratedTargets();
  std::int64_t newer = 0;  // a newer target has a lower bit
  for (const std::int64_t target : targets) {
    hwy::DisableTargets(newer);
    newer |= target;
    for (std::size_t i = 0; i < requests.size(); ++i) {
      const engine::FrameProducts here = scenery().renderer->render(requests[i]).products;
      if (target == targets.front()) first.push_back(here);
      EXPECT_TRUE(same_bytes(here, first[i])) << hwy::TargetName(target) << ", frame " << i;
    }
  }
  hwy::DisableTargets(0);
  EXPECT_GE(targets.size(), 2U) << "one of them without vectors";
  for (std::size_t i = 0; i < by_rays; ++i) {
    std::size_t points = 0, flags = 0;
    for (std::size_t k = 0; k < first[i].depth.size(); ++k) {
      const double a = first[i].depth[k], b = seen[i].depth[k];
      if (std::isnan(a) && std::isnan(b)) continue;
      points += !(std::abs(a - b) <= 0.01), flags += first[i].lit[k] != seen[i].lit[k];
    }
    EXPECT_EQ(points, 0U) << "frame " << i << ", by z-buffer and by rays";
    EXPECT_LE(flags * 1000, first[i].depth.size()) << "frame " << i;
  }
}

}  // namespace
}  // namespace selenograph::test
