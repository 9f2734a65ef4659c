// The limb in the image: in closed form for a Moon without relief, between rays that hit and rays that miss for a rough
// one. Rays go through places of the image, on a line across the limb. The terminator and a star's occultation
// likewise.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/camera/view.h"
#include "engine/sky/ephemeris.h"
#include "engine/sky/star_catalogue.h"
#include "dem/grid/rotation.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/moon_without_relief.h"
#include "tests/support/queries.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::test {
namespace {

constexpr double kLimbTolerance_px = 0.01;

// Above a place, near the limb's size, the centre off the middle of the image.
engine::LimbRequest of_whole_disc(double lat_deg, double lon_deg, double height_m, int points) {
  const Vec3 from = to_cartesian({lat_deg, lon_deg, height_m});
  const double radius_deg = std::asin(kMoonRadius_m / from.norm()) / kDegree;
  engine::LimbRequest request;
  request.camera = square_camera(1024, std::min(150.0, 2.4 * radius_deg));
  const EastNorthUp axes = local_axes(from);
  request.pose = looking(from, -from.normalized() + 0.1 * std::tan(radius_deg * kDegree / 2) * axes.east, axes.north);
  request.points = points;
  return request;
}

const int kAzimuths = full_effort() ? 1000 : 40;
constexpr double kHeights_m[] = {1e5, 2e6, 2e7, 4e8};

using LimbOfASphere = MoonWithoutRelief;

TEST_F(LimbOfASphere, IsACone) {
  for (const double height_m : kHeights_m) {
    const engine::LimbRequest request = of_whole_disc(20, 30, height_m, 100);
    const engine::View view(request.camera, request.pose);
    const Vec3 from = view.position(), centre = -from.normalized();
    double worst_px = 0;
    for (const engine::LimbPoint& p : test::find_limb(renderer(), request)) {
      ASSERT_TRUE(p.known());
      EXPECT_NEAR(p.sphere_angle_deg, std::asin(kMoonRadius_m / from.norm()) / kDegree, 1e-12);
      EXPECT_LT(p.position_m.norm(), kMoonRadius_m + 1e-6);
      EXPECT_GT(p.position_m.norm(), kMoonRadius_m - 2 * kFinestSag_m);
      if (!p.in_frame) continue;
      worst_px = std::max(worst_px, std::hypot(p.x_px - p.sphere_x_px, p.y_px - p.sphere_y_px));
      // What the image shows there, and at which azimuth: a small turn of the camera away from the centre.
      const Vec3 ray = view.ray(p.x_px, p.y_px)->normalized();
      EXPECT_NEAR(std::atan2(ray.cross(centre).norm(), ray.dot(centre)) / kDegree, p.angle_deg, 1e-9);
      const auto turn = shortest_turn(view.moon_from_camera().col(2), centre);
      const Vec3 turned = view.moon_from_camera().transpose() * (turn.conjugate() * ray);
      EXPECT_NEAR(std::remainder(std::atan2(turned.y(), turned.x()) / kDegree - p.azimuth_deg, 360), 0, 1e-6);
    }
    fmt::print("{:9.0f} km: {:.5f} px from the sphere's at most\n", height_m / 1000, worst_px);
    EXPECT_LT(worst_px, kLimbTolerance_px);
  }
}

TEST_F(LimbOfASphere, FromAFewMetres) {
  engine::LimbRequest request = of_whole_disc(-40, 100, 5, 12);
  for (const engine::LimbPoint& p : test::find_limb(renderer(), request)) {
    ASSERT_TRUE(p.known());
    EXPECT_NEAR(p.angle_deg, p.sphere_angle_deg, 0.01);
  }
}

class RoughLimb : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    write_global_tile(folder_->path(), 4, [](double lat_deg, double lon_deg) {
      const double round = std::cos(lat_deg * kDegree), lon = lon_deg * kDegree;
      return round * (2500 * std::sin(0.31 * lat_deg) * std::cos(17 * lon) +
                      1500 * std::sin(2.3 * lat_deg + 1) * std::sin(131 * lon) +
                      900 * std::cos(7.1 * lat_deg) * std::cos(517 * lon));
    });
    renderer_ = new engine::Renderer(open_terrain(folder_->path()), {0, std::size_t{1} << 30});
  }
  static void TearDownTestSuite() {
    delete renderer_, delete folder_;
    renderer_ = nullptr, folder_ = nullptr;
  }
  static inline TemporaryFolder* folder_ = nullptr;
  static inline engine::Renderer* renderer_ = nullptr;
};

// Whether a ray through the image meets the ground, at places across the limb, close to it and far.
struct AcrossTheLimb {
  std::size_t points = 0, wrong = 0;
  double relief_px = 0;
};
AcrossTheLimb look_across(const engine::Renderer& renderer, const engine::LimbRequest& request) {
  const engine::View view(request.camera, request.pose);
  const std::vector<double> offsets_px{-30, -0.3, -0.01, 0.01, 0.3, 30};
  AcrossTheLimb seen;
  std::vector<engine::Ray> rays;
  const engine::PixelXY centre = *view.project(Vec3::zero());  // it may be far beside the image
  for (const engine::LimbPoint& p : test::find_limb(renderer, request)) {
    if (!p.known() || !p.in_frame) continue;
    // In the half plane of its azimuth, whose image is a line through that of the centre.
    const Vec3 out = Vec3(p.x_px - centre.x, p.y_px - centre.y, 0).normalized();
    for (const double offset : offsets_px)
      rays.push_back({view.position(), view.ray(p.x_px + offset * out.x(), p.y_px + offset * out.y())->normalized()});
    seen.relief_px = std::max(seen.relief_px, std::hypot(p.x_px - p.sphere_x_px, p.y_px - p.sphere_y_px));
    ++seen.points;
  }
  const std::vector<engine::RayHit> hits = test::cast_rays(renderer, rays);
  for (std::size_t i = 0; i < hits.size(); ++i) seen.wrong += hits[i].hit != (offsets_px[i % offsets_px.size()] < 0);
  fmt::print("{} of {} rays on the wrong side; up to {:.3f} px from the sphere\n", seen.wrong, hits.size(),
             seen.relief_px);
  return seen;
}

TEST_F(RoughLimb, IsBetweenRaysThatHitAndRaysThatMiss) {
  for (const double height_m : kHeights_m) {
    const AcrossTheLimb seen = look_across(*renderer_, of_whole_disc(12, 200, height_m, kAzimuths));
    EXPECT_GT(seen.points, 0.9 * kAzimuths);  // not all are in the image
    EXPECT_GT(seen.relief_px, 0.5);
    EXPECT_EQ(seen.wrong, 0U);
  }
}

// Half planes in which a meridian of posts lies: rounding alone says on which side of them a post is.
TEST_F(RoughLimb, InAMeridianOfPostsIsThatBesideIt) {
  for (const auto& [lat_deg, lon_deg] :
       {std::pair{0.0, 0.0}, {0.0, 180.0}, {-45.0, 180.0}, {-90.0, 0.0}, {-90.0, 90.0}, {90.0, 0.0}})
    for (const double height_m : {1e5, 2e6, 4e8}) {
      if (height_m == 2e6 && !full_effort()) continue;
      SCOPED_TRACE(fmt::format("{} {}, {} m", lat_deg, lon_deg, height_m));
      engine::LimbRequest request = of_whole_disc(lat_deg, lon_deg, height_m, 36);
      const Vec3 from = request.pose.position_m;
      const EastNorthUp axes = local_axes(lat_deg, lon_deg);
      request.pose = looking(from, -from, axes.north);
      const std::vector<engine::LimbPoint> at = test::find_limb(*renderer_, request);
      request.pose = looking(from, -from, axes.north + 1e-7 * kDegree * axes.east);  // 3 mm on the ground
      const std::vector<engine::LimbPoint> beside = test::find_limb(*renderer_, request);
      for (std::size_t i = 0; i < at.size(); ++i) {
        ASSERT_TRUE(at[i].known() && beside[i].known()) << at[i].azimuth_deg;
        EXPECT_LT(std::abs(at[i].angle_deg - beside[i].angle_deg) * kDegree * at[i].range_m, 0.01) << at[i].azimuth_deg;
      }
    }
}

// In a half plane that begins at the line to the Sun, rays from the Sun: the terminator is between those that meet the
// ground and those that do not.
TEST_F(RoughLimb, TheTerminatorIsTheLastLitGround) {
  engine::LimbRequest request = of_whole_disc(12, 200, 2e7, 100);
  request.sun.emplace();
  request.sun->direction = to_cartesian({-20, 110, 0}).normalized();
  const Vec3 sun = request.sun->distance_au * engine::kAstronomicalUnit_m * request.sun->direction;
  std::vector<engine::Ray> rays;
  int visible = 0;
  for (const engine::TerminatorPoint& p : test::find_terminator(*renderer_, request)) {
    ASSERT_TRUE(p.known());
    const Vec3 outward = (p.position_m - p.position_m.dot(sun) / sun.squared_norm() * sun).normalized();
    // From above all terrain. Float, which finds the triangles, knows a grazing ray to some centimetres.
    const Vec3 along = (p.position_m - sun).normalized(), from = p.position_m - 3e6 * along;
    for (const double offset_m : {-3.0, -0.3, 0.3, 3.0}) rays.push_back({from + offset_m * outward, along});
    if (p.visible) ++visible;
    EXPECT_NEAR(p.position_m.norm(), kMoonRadius_m, 6e3);
  }
  const std::vector<engine::RayHit> hits = test::cast_rays(*renderer_, rays);
  for (std::size_t i = 0; i < hits.size(); ++i) EXPECT_EQ(hits[i].hit, i % 4 < 2) << i;
  EXPECT_GT(visible, 30);
  EXPECT_LT(visible, 70);
}

// Real terrain: the whole Moon, and finer posts of a piece of it at the limb, in large pixels and in small ones.
class RealLimb : public ::testing::Test {
 protected:
  static std::string global() { return shared_data("global"); }
  // Of the whole Moon, for all tests: its pyramid is made once.
  static const engine::Renderer& whole_moon() {
    static const engine::Renderer renderer(terrain({global()}), {0, std::size_t{1} << 30});
    return renderer;
  }
  static std::shared_ptr<dem::PyramidTerrain> terrain(const std::vector<std::string>& folders) {
    return std::make_shared<dem::PyramidTerrain>(dem::Catalogue(folders),
                                                 dem::TerrainOptions{{}, std::size_t{512} << 20});
  }
};

TEST_F(RealLimb, OfTheWholeMoonIsBetweenRays) {
  SELENOGRAPH_SKIP_WITHOUT(global());
  for (const double height_m : kHeights_m) {
    const AcrossTheLimb seen = look_across(whole_moon(), of_whole_disc(-5, 20, height_m, kAzimuths));
    EXPECT_GT(seen.points, 0.9 * kAzimuths);  // not all are in the image
    EXPECT_EQ(seen.wrong, 0U);
  }
}

TEST_F(RealLimb, OfFinePostsAmongCoarseOnesIsBetweenRays) {
  SELENOGRAPH_SKIP_WITHOUT(shared_data("hadley"));
  SELENOGRAPH_SKIP_WITHOUT(global());
  const engine::Renderer renderer(terrain({global(), shared_data("hadley")}), {0, std::size_t{1} << 30});
  const Vec3 from = to_cartesian({24, 75, 2e6}), there = to_cartesian({24, 6, 0});
  engine::LimbRequest request;
  request.camera = square_camera(1024, 5);  // 290 m per pixel
  request.pose = looking(from, there - from, Vec3::unit_z());
  request.points = full_effort() ? 10000 : 4000;
  const AcrossTheLimb seen = look_across(renderer, request);
  EXPECT_GT(seen.points, full_effort() ? 200U : 80U);
  EXPECT_EQ(seen.wrong, 0U);
}

// The camera moves until a star rises from behind a mountain, as POST /v1/sky has it.
TEST_F(RealLimb, AStarGoesBehindAMountain) {
  SELENOGRAPH_SKIP_WITHOUT(global());
  const engine::Renderer& renderer = whole_moon();
  const std::string utc = "2026-11-25T00:00:00Z";
  const engine::LimbRequest disc = of_whole_disc(-5, 20, 2e6, 360);
  const std::vector<engine::LimbPoint> points = test::find_limb(renderer, disc);
  const engine::LimbPoint& mountain = *std::max_element(
      points.begin(), points.end(), [](const auto& a, const auto& b) { return a.angle_deg < b.angle_deg; });
  EXPECT_GT(mountain.position_m.norm(), kMoonRadius_m + 3000);
  const Vec3 from = disc.pose.position_m, toward = (mountain.position_m - from).normalized();
  const Vec3 d = engine::moon_me_from_icrf(utc).transpose() * toward;
  const double ra_deg = std::atan2(d.y(), d.x()) / kDegree;
  engine::FrameRequest frame = blank_request();
  frame.camera = square_camera(256, 1);
  frame.sky.emplace();
  frame.sky->utc = utc;
  frame.sky->stars = std::make_shared<const engine::StarCatalogue>(
      "one", std::vector<engine::StarRow>{
                 {"A", ra_deg < 0 ? ra_deg + 360 : ra_deg, std::asin(d.z()) / kDegree, 2000, 0, 0, 0, 2, 0.65}});
  Vec3 star = toward;  // with aberration, 20 arcsec
  const auto sees = [&](const Vec3& place) {
    frame.pose = looking(place, toward, from);
    const auto sky = test::query_sky(renderer, frame);
    EXPECT_EQ(sky.size(), 1U);
    star = sky.at(0).direction;
    return sky.at(0).hidden_by == engine::HiddenBy::none;
  };
  const Vec3 aside = (toward - toward.dot(from) / from.squared_norm() * from).normalized();
  double hidden_m = -3000, seen_m = 3000;
  ASSERT_FALSE(sees(from + hidden_m * aside));
  ASSERT_TRUE(sees(from + seen_m * aside));
  while (seen_m - hidden_m > 1e-3) {
    const double middle_m = (hidden_m + seen_m) / 2;
    (sees(from + middle_m * aside) ? seen_m : hidden_m) = middle_m;
  }
  const auto hit = [&](double at_m) {
    return test::cast_rays(renderer, std::vector<engine::Ray>{{from + at_m * aside, star}}).at(0).hit;
  };
  EXPECT_TRUE(hit(hidden_m - 0.002));
  EXPECT_FALSE(hit(seen_m + 0.002));
  // The limb at the star's azimuth, which is 0 here.
  engine::LimbRequest limb;
  const Vec3 place = from + seen_m * aside, down = -place.normalized();
  const Vec3 right = (star - star.dot(down) * down).normalized();
  limb.camera = square_camera(256, 60), limb.pose = looking(place, down, right.cross(down)), limb.points = 3;
  const engine::LimbPoint at_star = test::find_limb(renderer, limb).at(0);
  const double off_rad = std::atan2(star.cross(down).norm(), star.dot(down)) - at_star.angle_deg * kDegree;
  fmt::print("the star is {:.4f} m above the limb, which is {:.0f} m high\n", off_rad * at_star.range_m,
             at_star.position_m.norm() - kMoonRadius_m);
  EXPECT_LT(std::abs(off_rad) * at_star.range_m, 0.01);
}

// Voids: half of the Moon. Beyond them nobody knows.
TEST(LimbWithVoids, HasNoPointsThere) {
  const TemporaryFolder folder;
  write_float_tile(folder.path(), "east", {60, 0, 4, 4 * 120 + 1, 4 * 180 + 1}, [](double, double) { return 100.0; });
  const engine::Renderer renderer(open_terrain(folder.path()), {1, std::size_t{512} << 20});
  // The northern and southern limb are beyond 60 degrees; the eastern one has data, the western one none.
  engine::LimbRequest request = of_whole_disc(0, 60, 1e7, 40);
  const auto points = test::find_limb(renderer, request);
  EXPECT_TRUE(points[0].known());  // east is right
  EXPECT_FALSE(points[10].known());
  EXPECT_FALSE(points[20].known());
  EXPECT_FALSE(points[30].known());
  EXPECT_TRUE(std::isfinite(points[20].sphere_x_px));
  request.pose.position_m = to_cartesian({0, 60, 50});
  EXPECT_THROW(test::find_limb(renderer, request), std::runtime_error);
}

}  // namespace
}  // namespace selenograph::test
