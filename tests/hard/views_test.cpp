// Views where cameras have their corners: along the ground, straight up, out of craters and shadows, through a keyhole
// and through half a sphere, and through lenses that fold.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "engine/camera/view.h"
#include "tests/support/frame_judge.h"
#include "tests/support/hard_views.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"
#include "tests/support/vec_text.h"

namespace selenograph::test {
namespace {

using engine::Distortion;
using engine::Frame;
using engine::FrameRequest;

// ---- over crags with a crater of 9 km in them ----------------------------------------------------------------------

constexpr Geographic kCrater{40.5, 70.5, 0};
constexpr double kCraterRadius_m = 4500, kCraterDepth_m = 1800, kRim_m = 400;

// A paraboloid with a raised rim that falls off to the plain.
double crater(double lat_deg, double lon_deg) {
  const double r = (to_cartesian({lat_deg, lon_deg, 0}) - to_cartesian(kCrater)).norm() / kCraterRadius_m;
  const double bowl = r < 1 ? kRim_m - kCraterDepth_m * (1 - r * r) : kRim_m * std::exp(-4 * (r - 1));
  return bowl + (r < 1 ? 0.02 : 0.2) * crags(lat_deg, lon_deg);
}

class HardViews : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    write_kaguya_tile(folder_->path(), 41, 70, 1, 512, crater);
    scenery_ = new Scenery(folder_->path());
  }
  static void TearDownTestSuite() {
    delete scenery_;
    delete folder_;
    scenery_ = nullptr, folder_ = nullptr;
  }
  static const engine::Renderer& renderer() { return *scenery_->renderer; }
  static const Judge& judge() { return *scenery_->judge; }

  static Vec3 above_ground(double lat_deg, double lon_deg, double height_m) {
    return to_cartesian({lat_deg, lon_deg, scenery_->terrain->height(lat_deg, lon_deg).height_m + height_m});
  }
  static Vec3 sun(double azimuth_deg, double elevation_deg) {
    return local_direction(to_cartesian(kCrater), azimuth_deg, elevation_deg);
  }

  static Findings expect_judged(const std::string& name, const FrameRequest& request) {
    SCOPED_TRACE(name);
    const Findings found = judged(judge(), request, renderer().render(request));
    report(name, found);
    EXPECT_EQ(found.off_ray + found.off_terrain + found.unexplained + found.unknown, 0u);
    EXPECT_LE(found.outlines * 1000, found.pixels);
    EXPECT_LE(found.wrong * 10000, found.pixels);
    return found;
  }

  static inline TemporaryFolder* folder_ = nullptr;
  static inline Scenery* scenery_ = nullptr;
};

TEST_F(HardViews, AlongTheSurface) {
  for (const auto& [lat, lon] : {std::pair(40.3, 70.25), {40.5, 70.66}, {40.72, 70.4}}) {
    const Vec3 eye = above_ground(lat, lon, 2);
    for (const double azimuth : {0.0, 90.0, 180.0, 270.0, 333.3}) {
      const FrameRequest request =
          square_view(looking(eye, local_direction(eye, azimuth, 0), eye), 48, 60, sun(120, 12));
      const Findings found = expect_judged(fmt::format("2 m above {} {}, azimuth {}", lat, lon, azimuth), request);
      EXPECT_GT(found.hits, found.pixels / 5) << "the ground before its feet";
    }
  }
}

TEST_F(HardViews, SkyHasNoHits) {
  for (const double fov_deg : {0.01, 40.0, 90.0}) {
    const Vec3 eye = above_ground(40.3, 70.25, 2);
    FrameRequest request = square_view(looking(eye, eye, local_axes(eye).north), 48, fov_deg, sun(120, 12));
    request.products |= engine::kImage | engine::kSource | engine::kAngles;
    const Frame frame = renderer().render(request);
    EXPECT_EQ(frame.report.hit_fraction, 0);
    EXPECT_EQ(frame.report.missing_fraction, 0) << "the sky isn't missing data";
    EXPECT_EQ(frame.report.filled_fraction, 0);
    EXPECT_TRUE(frame.report.sources.empty());
    for (std::size_t i = 0; i < frame.products.depth.size(); ++i) {
      ASSERT_TRUE(std::isnan(frame.products.depth[i]) && std::isnan(frame.products.lit[i]) &&
                  std::isnan(frame.products.angles[3 * i]));
      ASSERT_EQ(frame.products.radiance[i], 0.F);
      ASSERT_EQ(frame.products.image[i], 0);
      ASSERT_EQ(frame.products.source[i], 65535);
    }
  }
}

TEST_F(HardViews, FromACratersBottom) {
  const Vec3 eye = above_ground(kCrater.lat_deg, kCrater.lon_deg, 2);
  const Findings up = expect_judged("crater's bottom, up, 150 deg",
                                    square_view(looking(eye, eye, local_axes(eye).north), 64, 150, sun(200, 20)));
  EXPECT_GT(up.hits, up.pixels / 20) << "the walls";
  EXPECT_LT(up.hits, up.pixels - up.pixels / 20) << "the sky";
  for (const double azimuth : {20.0, 200.0}) {
    const Findings wall =
        expect_judged(fmt::format("crater's bottom, azimuth {}", azimuth),
                      square_view(looking(eye, local_direction(eye, azimuth, 10), eye), 64, 50, sun(200, 20)));
    EXPECT_GT(wall.hits, wall.pixels / 4);
  }
}

TEST_F(HardViews, FromInsideAShadow) {
  const Vec3 light = sun(90, 8);
  // Below the eastern rim the wall is in its own shadow.
  const Vec3 eye = above_ground(40.5, 70.62, 2), down = -eye.normalized();
  const FirstHit ground = judge().first_hit(eye, down);
  ASSERT_EQ(ground.hit, Verdict::yes);
  ASSERT_EQ(judge().sun_blocked(eye + ground.distance_m * down, ground.face, light), Verdict::yes);
  for (const double azimuth : {90.0, 250.0, 270.0}) {
    const Findings found =
        expect_judged(fmt::format("inside a shadow, azimuth {}", azimuth),
                      square_view(looking(eye, local_direction(eye, azimuth, -5), eye), 64, 70, light));
    EXPECT_LT(found.lit, found.hits) << "its own surroundings are dark";
  }
}

TEST_F(HardViews, FieldsOfViewFromAKeyholeToHalfASphere) {
  const auto from = [](double height_m) { return Geographic{40.5, 70.45, height_m}; };
  // 17 m from 100 km: all pixels on one or two triangles. 70 km from 400 000 km: the whole tile and what is beside it.
  expect_judged("0.01 deg from 100 km", nadir_view(from(100e3), 64, 0.01, sun(120, 12)));
  expect_judged("0.01 deg from 400 000 km", nadir_view(from(400e6), 64, 0.01, sun(120, 12)));
  const Vec3 near = above_ground(40.5, 70.45, 2);
  expect_judged("0.01 deg from 2 m, along the ground",
                square_view(looking(near, local_direction(near, 80, -1), near), 64, 0.01, sun(120, 12)));
  expect_judged("170 deg from 2 km", nadir_view(from(2000), 128, 170, sun(120, 12)));
  const Findings wide =
      expect_judged("170 deg from 2 m, along the ground",
                    square_view(looking(near, local_direction(near, 300, 0), near), 128, 170, sun(120, 12)));
  EXPECT_GT(wide.hits, wide.pixels / 4);
}

// ---- lenses --------------------------------------------------------------------------------------------------------

// The model as it is published (Brown 1966, OpenCV's coefficients), written down a second time.
struct Lens {
  Distortion d;

  std::pair<double, double> forward(double x, double y) const {
    const double r2 = x * x + y * y, radial = 1 + d.k1 * r2 + d.k2 * r2 * r2 + d.k3 * r2 * r2 * r2;
    return {x * radial + 2 * d.p1 * x * y + d.p2 * (r2 + 2 * x * x),
            y * radial + d.p1 * (r2 + 2 * y * y) + 2 * d.p2 * x * y};
  }
  // What a small circle becomes, in area; by central differences.
  double unfolded(double x, double y) const {
    const double h = 1e-6 * (1 + std::hypot(x, y));
    const auto [xe, ye] = forward(x + h, y);
    const auto [xw, yw] = forward(x - h, y);
    const auto [xn, yn] = forward(x, y + h);
    const auto [xs, ys] = forward(x, y - h);
    return ((xe - xw) * (yn - ys) - (ye - yw) * (xn - xs)) / (4 * h * h);
  }
  // Smallest area on the way from the axis: not positive when the lens folds before this place.
  double least_unfolded(double x, double y) const {
    double least = 1;
    for (int i = 1; i <= 400; ++i) least = std::min(least, unfolded(x * i / 400, y * i / 400));
    return least;
  }
  // The inverse by walking outwards from the axis in steps so small that each is a correction. Stops at the fold, and
  // what has leapt over it all the same is behind it.
  std::optional<std::pair<double, double>> walked_to(double xd, double yd) const {
    double x = 0, y = 0;
    constexpr int kSteps = 300;
    for (int i = 1; i <= kSteps; ++i)
      for (int k = 0; k < 3; ++k) {
        if (unfolded(x, y) < 1e-3) return std::nullopt;
        const double h = 1e-6 * (1 + std::hypot(x, y));
        const auto [fx, fy] = forward(x, y);
        const auto [xe, ye] = forward(x + h, y);
        const auto [xn, yn] = forward(x, y + h);
        const double a = (xe - fx) / h, b = (xn - fx) / h, c = (ye - fy) / h, e = (yn - fy) / h, det = a * e - b * c;
        const double mx = xd * i / kSteps - fx, my = yd * i / kSteps - fy;
        x += (e * mx - b * my) / det, y += (a * my - c * mx) / det;
      }
    const auto [fx, fy] = forward(x, y);
    if (std::hypot(fx - xd, fy - yd) > 1e-9 || least_unfolded(x, y) < 1e-3) return std::nullopt;
    return std::pair(x, y);
  }
};

std::vector<Distortion> strong_lenses() {
  std::vector<Distortion> all{{-0.45, 0, 0, 0, 0},       {-5, 0, 0, 0, 0},          {0.5, -0.8, 0, 0, 0},
                              {-0.6, 0.3, 0, 0, 0},      {-0.6, 0.1, 0, 0, 0},      {1, -1, 0.2, 0, 0},
                              {0, 0, -0.3, 0, 0},        {0, 0, 0, 0.2, 0},         {0, 0, 0, 0, -0.2},
                              {0, 0, 0, 0.15, 0.15},     {-0.4, 0.1, 0, 0.1, -0.1}, {0.5, 0.5, 0.5, 0.3, 0.3},
                              {-0.45, 0, 0, 0.05, 0.02}, {3, 0, 0, -0.5, 0.4},      {1e6, 1e6, 1e6, 0, 0},
                              {-1e6, 0, 0, 0, 0},        {0, 0, 0, 1e6, -1e6}};
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 40; ++i)
    all.push_back(
        {0.5 * normal(random), 0.3 * normal(random), 0.2 * normal(random), 0.1 * normal(random), 0.1 * normal(random)});
  return all;
}

// For each pixel a ray that the lens maps to it, without a fold on the way; or none, where a walk from the axis to that
// pixel finds the fold too.
TEST(StrongLenses, OneRayPerPixelUpToTheFold) {
  std::size_t rays = 0, masked = 0, folded = 0, wrongly_masked = 0;
  double worst_px = 0;
  for (const Distortion& d : strong_lenses()) {
    const Lens lens{d};
    const engine::Camera camera{100, 80, 50, 50, 49.5, 39.5, d};
    const engine::View view(camera, {Vec3(2e6, 0, 0), Quat::identity()});
    for (int y = 0; y < camera.height; y += 3)
      for (int x = 0; x < camera.width; x += 3) {
        const double xd = (x - camera.cx) / camera.fx, yd = (y - camera.cy) / camera.fy;
        const auto ray = view.ray(x, y);
        if (!ray) {
          ++masked;
          if (const auto place = lens.walked_to(xd, yd)) {
            ++wrongly_masked;
            ADD_FAILURE() << "masked this side of the fold: " << x << ' ' << y << " is at " << place->first << ' '
                          << place->second << ", unfolded " << lens.least_unfolded(place->first, place->second) << " k "
                          << d.k1 << ' ' << d.k2 << ' ' << d.k3 << " p " << d.p1 << ' ' << d.p2;
          }
          continue;
        }
        ++rays;
        const auto [fx, fy] = lens.forward(ray->x() / ray->z(), ray->y() / ray->z());
        const double off_px = 50 * std::hypot(fx - xd, fy - yd);
        worst_px = std::max(worst_px, off_px);
        EXPECT_LT(off_px, 1e-6) << x << ' ' << y << " k " << d.k1 << ' ' << d.k2 << ' ' << d.k3 << " p " << d.p1 << ' '
                                << d.p2;
        // A positive area so small that differences can't tell it from zero is the fold itself.
        if (lens.least_unfolded(ray->x(), ray->y()) < -1e-6) {
          ++folded;
          ADD_FAILURE() << "a ray from behind the fold at " << x << ' ' << y << ": " << *ray << " k " << d.k1 << ' '
                        << d.k2 << ' ' << d.k3 << " p " << d.p1 << ' ' << d.p2;
        }
      }
  }
  fmt::print(
      "{} lenses: {} rays come back to their pixels within {:.1e} px, {} from behind a fold; {} pixels without, {} "
      "of them this side of the fold\n",
      strong_lenses().size(), rays, worst_px, folded, masked, wrongly_masked);
  EXPECT_EQ(wrongly_masked, 0u);
  EXPECT_GT(rays, 10000u);
  EXPECT_GT(masked, 3000u);
}

}  // namespace
}  // namespace selenograph::test
