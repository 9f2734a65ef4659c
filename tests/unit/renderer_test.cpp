// Frames in closed form: over a smooth sphere every product has a formula.
#include "engine/renderer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>
#include <random>

#include "dem/base/error.h"
#include "dem/sample/sample_terrain.h"
#include "engine/camera/view.h"
#include "engine/radiometry/photometry.h"
#include "tests/support/float_tiles.h"
#include "tests/support/moon_without_relief.h"
#include "tests/support/queries.h"
#include "tests/support/same_bytes.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

using test::at3;
using test::local_sun;
using test::looking;
using test::same_bytes;
using test::TemporaryFolder;

FrameRequest nadir(double lat, double lon, double height_m, int size, double fov_deg) {
  FrameRequest request;
  request.camera = test::square_camera(size, fov_deg);
  const Vec3 from = to_cartesian({lat, lon, height_m});
  request.pose = looking(from, -from, local_axes(from).north);
  request.sun.direction = local_sun(lat, lon, 90, 40);
  request.products = kRadiance | kDepth | kRange | kPosition | kGeodetic | kNormal | kAngles | kLit | kGsd | kSource;
  return request;
}

using SmoothMoon = test::MoonWithoutRelief;

TEST_F(SmoothMoon, EveryProductHasItsFormula) {
  FrameRequest request = nadir(20, 30, 20000, 64, 50);
  request.sun.distance_au = 1.01;
  request.accuracy.max_error_px = 0;
  const View view(request.camera, request.pose);
  const Frame frame = renderer().render(request);
  const FrameProducts& p = frame.products;
  ASSERT_EQ(frame.report.hit_fraction, 1);
  EXPECT_EQ(frame.report.missing_fraction, 0);
  EXPECT_EQ(frame.report.filled_fraction, 0);
  EXPECT_NEAR(frame.report.radiance.direct_w_m2, 1361 / (1.01 * 1.01), 1e-9);
  ASSERT_EQ(frame.report.sources.size(), 1U);
  EXPECT_EQ(frame.report.sources[0].name, "global");
  for (std::size_t i = 0; i < p.depth.size(); ++i) {
    const Vec3 ray = *view.ray(static_cast<double>(i % 64), static_cast<double>(i / 64)), from = view.position();
    const double a = ray.squared_norm(), b = from.dot(ray), c = from.squared_norm() - kMoonRadius_m * kMoonRadius_m;
    const double depth = (-b - std::sqrt(b * b - a * c)) / a;
    // The finest mesh's chords lie up to 2 mm beneath the sphere; a ray's point with them.
    ASSERT_NEAR(p.depth[i], depth, 0.004) << i;
    ASSERT_NEAR(p.range[i], p.depth[i] * std::sqrt(a), 1e-8);
    const Vec3 position = at3(p.position, i);
    ASSERT_LT((position - (from + p.depth[i] * ray)).norm(), 1e-8);
    const Geographic g = to_geographic(position);
    ASSERT_NEAR(p.geodetic[3 * i], g.lat_deg, 1e-12);
    ASSERT_NEAR(p.geodetic[3 * i + 1], g.lon_deg, 1e-12);
    ASSERT_NEAR(p.geodetic[3 * i + 2], 0, 0.0025);
    ASSERT_LE(p.geodetic[3 * i + 2], 1e-6);
    const Vec3 normal = position.normalized();
    ASSERT_LT((at3(p.normal, i) - normal).norm(), 1e-5);
    const double mu0 = normal.dot(request.sun.direction), mu = -normal.dot(ray) / std::sqrt(a);
    ASSERT_NEAR(static_cast<double>(p.radiance[i]),
                1361 / (1.01 * 1.01) * mu0 * 0.12 / (2 * std::numbers::pi) / (mu0 + mu), 1e-3);
    ASSERT_NEAR(static_cast<double>(p.angles[3 * i]), std::acos(mu0) * 180 / std::numbers::pi, 1e-3);
    ASSERT_NEAR(std::cos(static_cast<double>(p.angles[3 * i + 1]) * std::numbers::pi / 180), mu, 1e-5);
    ASSERT_NEAR(static_cast<double>(p.angles[3 * i + 2]),
                std::acos(-ray.normalized().dot(request.sun.direction)) * 180 / std::numbers::pi, 1e-3);
    ASSERT_EQ(p.lit[i], 1.F);
    ASSERT_EQ(p.source[i], 0);
    ASSERT_NEAR(static_cast<double>(p.gsd[i]), dem::post_spacing_m(8), 1e-3);
  }
}

TEST_F(SmoothMoon, OnlyWhatIsAskedFor) {
  FrameRequest request = nadir(0, 0, 20000, 16, 40);
  for (const Product wanted :
       {kImage, kRadiance, kDepth, kRange, kPosition, kGeodetic, kNormal, kAngles, kLit, kGsd, kSource}) {
    request.products = wanted;
    const FrameProducts p = renderer().render(request).products;
    EXPECT_EQ(p.image.size(), wanted == kImage ? 256U : 0U);
    EXPECT_EQ(p.radiance.size(), wanted == kRadiance ? 256U : 0U);
    EXPECT_EQ(p.depth.size(), wanted == kDepth ? 256U : 0U);
    EXPECT_EQ(p.range.size(), wanted == kRange ? 256U : 0U);
    EXPECT_EQ(p.position.size(), wanted == kPosition ? 768U : 0U);
    EXPECT_EQ(p.geodetic.size(), wanted == kGeodetic ? 768U : 0U);
    EXPECT_EQ(p.normal.size(), wanted == kNormal ? 768U : 0U);
    EXPECT_EQ(p.angles.size(), wanted == kAngles ? 768U : 0U);
    EXPECT_EQ(p.lit.size(), wanted == kLit ? 256U : 0U);
    EXPECT_EQ(p.gsd.size(), wanted == kGsd ? 256U : 0U);
    EXPECT_EQ(p.source.size(), wanted == kSource ? 256U : 0U);
  }
}

TEST_F(SmoothMoon, ProductsDontDependOnEachOther) {
  FrameRequest request = nadir(0, 0, 20000, 24, 40);
  const FrameProducts all = renderer().render(request).products;
  request.products = kRadiance;
  EXPECT_EQ(renderer().render(request).products.radiance, all.radiance);
  request.products = kLit;
  EXPECT_EQ(renderer().render(request).products.lit, all.lit);
  request.products = kDepth | kImage;
  EXPECT_EQ(renderer().render(request).products.depth, all.depth);
  // Nor on the samples of the radiance: the others are of a pixel's centre.
  request.products = kLit | kIrradiance;
  const FrameProducts light = renderer().render(request).products;
  EXPECT_GT(light.irradiance.front(), 0);
  request.accuracy.samples_per_pixel = 4;
  for (const ProductSet products : {ProductSet{kIrradiance}, ProductSet{kIrradiance | kRadiance}})
    for (const Visibility way : {Visibility::zbuffer, Visibility::raytrace}) {
      request.products = products, request.visibility = way;
      EXPECT_EQ(renderer().render(request).products.irradiance, light.irradiance);
    }
}

TEST_F(SmoothMoon, SamplesPerPixelAreAMean) {
  // Over the limb: a pixel's radiance is the share of its samples that see the Moon times theirs.
  FrameRequest request = nadir(0, 0, 400000e3, 24, 0.6);
  request.sun.direction = local_sun(0, 0, 0, 90);
  request.products = kRadiance;
  request.accuracy.samples_per_pixel = 16;
  const auto mean = renderer().render(request).products.radiance;
  // The same samples as pixels of a camera with four times the resolution.
  FrameRequest fine = request;
  fine.camera = {96,
                 96,
                 4 * request.camera.fx,
                 4 * request.camera.fy,
                 4 * (request.camera.cx + 0.5) - 0.5,
                 4 * (request.camera.cy + 0.5) - 0.5,
                 {}};
  fine.accuracy.samples_per_pixel = 1;
  fine.accuracy.max_error_px = 4 * request.accuracy.max_error_px;
  fine.accuracy.max_shadow_error_px = 4 * request.accuracy.max_shadow_error_px;
  const auto samples = renderer().render(fine).products.radiance;
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 24; ++x) {
      double sum = 0;
      for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 4; ++i)
          sum += static_cast<double>(samples[static_cast<std::size_t>((4 * y + j) * 96 + 4 * x + i)]);
      ASSERT_NEAR(static_cast<double>(mean[static_cast<std::size_t>(y * 24 + x)]), sum / 16, 1e-4 * sum / 16 + 1e-5)
          << x << ' ' << y;
    }
}

TEST_F(SmoothMoon, CancelledInTime) {
  FrameRequest request = nadir(5, 5, 20000, 1024, 50);
  request.accuracy.samples_per_pixel = 25;
  EXPECT_THROW(renderer().render(request, StopToken(StopToken::Clock::now())), Cancelled);
  FrameRequest first = request;
  first.accuracy.samples_per_pixel = 1, first.camera.width = first.camera.height = 8,
  first.camera.cx = first.camera.cy = 511.5;
  renderer().render(first);
  const auto start = StopToken::Clock::now();
  EXPECT_THROW(renderer().render(request, StopToken(start + std::chrono::milliseconds(30))), Cancelled);
  EXPECT_LT(StopToken::Clock::now() - start, std::chrono::seconds(3));
  const std::atomic<bool> abandoned{true};
  EXPECT_THROW(renderer().render(request, StopToken(StopToken::Clock::time_point::max(), &abandoned)), Cancelled);
}

TEST_F(SmoothMoon, CamerasBelowTheTerrainAreRefused) {
  FrameRequest request = nadir(5, 5, -1, 16, 50);
  EXPECT_THROW(renderer().render(request), ImpossibleRequest);
  request.pose.position_m = Vec3::zero();
  EXPECT_THROW(renderer().render(request), ImpossibleRequest);
  request = nadir(5, 5, 0.5, 16, 50);
  EXPECT_NO_THROW(renderer().render(request));
}

// As far away as requests may say; a ray from the Moon's middle meets no ground from above, and misleads no other.
TEST_F(SmoothMoon, RaysFromFarAwayMeetTheSphere) {
  const Vec3 place = to_cartesian({-12.13, 77.21, 0});
  std::vector<Ray> rays{{Vec3::zero(), place.normalized()}};
  for (double from_m = 1e7; from_m <= 1e12; from_m *= 10) {
    const Vec3 from = to_cartesian({-12, 77, from_m});
    rays.push_back({from, (place - from).normalized()});
  }
  const auto hits = test::cast_rays(renderer(), rays, Sun{local_sun(-12, 77, 0, 30), 1, 0});
  EXPECT_FALSE(hits[0].hit);
  for (std::size_t i = 1; i < rays.size(); ++i) {
    ASSERT_TRUE(hits[i].hit) << i;
    EXPECT_LT((hits[i].position_m - place).norm(), 0.01 + 1e-15 * rays[i].origin_m.norm()) << i;
    EXPECT_EQ(hits[i].lit, 1) << i;
  }
}

struct Differences {
  std::size_t places = 0;
  double worst_m = 0;
};

// Of the terrain's heights and those at which rays meet it from above.
Differences heights_and_rays(const Renderer& renderer, const std::vector<Geographic>& places) {
  std::vector<Ray> rays;
  for (const Geographic& place : places) {
    const Vec3 from = to_cartesian({place.lat_deg, place.lon_deg, 20000});
    rays.push_back({from, -from.normalized()});
  }
  const auto hits = test::cast_rays(renderer, rays);
  Differences found;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const double height_m = renderer.terrain().height(places[i].lat_deg, places[i].lon_deg).height_m;
    if (!hits[i].hit || std::isnan(height_m)) continue;
    ++found.places;
    found.worst_m = std::max(found.worst_m, std::abs(to_geographic(hits[i].position_m).height_m - height_m));
  }
  return found;
}

// Fine posts in a corner of coarse ones: where the finest blocks of either meet, coarser ones decide the edge's
// heights.
TEST(FinestSurface, HeightsAreWhatRaysMeetWherePostsOfTwoSpacingsMeet) {
  const TemporaryFolder folder;
  dem::SampleOptions coarse, fine;
  coarse.south_deg = -6, coarse.rows = 3, coarse.columns = 2, coarse.posts_per_degree = 64;
  fine.south_deg = -6, fine.rows = fine.columns = 1, fine.posts_per_degree = 512;
  dem::write_sample_terrain(folder.path(), coarse);
  dem::write_sample_terrain(folder / "fine", fine);
  const Renderer renderer(test::open_terrain(folder.path()), RendererOptions{2, std::size_t{512} << 20});
  // Across the borders of blocks of 1, 1/2 and 1/4 degree, north and east of the fine posts.
  std::vector<Geographic> places;
  for (const double border : {-5.0, -4.75, -4.5, -4.0})
    for (int i = -60; i < 60; ++i) {
      places.push_back({border + 5e-5 * i, 39.3 + 0.0137 * (i & 15), 0});
      places.push_back({-5.6 + 0.0137 * (i & 15), 45 + border + 5e-5 * i, 0});
    }
  const Differences found = heights_and_rays(renderer, places);
  EXPECT_GT(found.places, 700U);
  EXPECT_LT(found.worst_m, 1e-6);
}

// From a parallel on every other post is left out in longitude: between the others lies another curve.
TEST(FinestSurface, HeightsAreWhatRaysMeetWherePostsAreLeftOut) {
  const TemporaryFolder folder;
  const auto rough = [](double lat, double lon) { return std::round(900 * std::sin(lat * 7) * std::cos(lon * 5)); };
  test::write_float_tile(folder.path(), "coarse", {84, 2, 4, 65, 49}, rough);
  const Renderer renderer(test::open_terrain(folder.path()), RendererOptions{2, std::size_t{512} << 20});
  std::vector<Geographic> places;
  for (int parallel = 73; parallel < 84; ++parallel)
    for (int i = -30; i < 30; ++i) places.push_back({parallel + 1.3e-4 * i, 8 + 0.0173 * i, 0});
  const Differences found = heights_and_rays(renderer, places);
  EXPECT_GT(found.places, 600U);
  EXPECT_LT(found.worst_m, 1e-6);
}

// One mountain on an otherwise smooth plain, finest posts of level 8 (474 m): a cone, 3 posts wide.
class Mountain : public ::testing::Test {
 protected:
  static constexpr double kLat = 10, kLon = 30;
  static double cone(double height, double lat, double lon) {
    const double r_deg = std::hypot(lat - kLat, (lon - kLon) * std::cos(kLat * std::numbers::pi / 180));
    return std::max(0.0, height * (1 - r_deg / 0.02));
  }
  // Tiles of four degrees, level 8; the mountain stands a quarter of a degree east of a seam.
  static std::shared_ptr<dem::PyramidTerrain> open(const TemporaryFolder& folder, double height) {
    for (int k = 0; k < 3; ++k)
      test::write_float_tile(folder.path(), "tile" + std::to_string(k), {12, 21.75 + 4 * k, 256, 4 * 256 + 1, 4 * 256},
                             [=](double lat, double lon) { return cone(height, lat, lon); });
    return test::open_terrain(folder.path());
  }
};

TEST_F(Mountain, ThrowsItsShadowIntoViewFromOutside) {
  for (const auto& [elevation, height] : {std::pair(2.0, 800.0), std::pair(5.0, 3000.0), std::pair(15.0, 5000.0)}) {
    TemporaryFolder folder;
    const Renderer renderer(open(folder, height), {2, std::size_t{512} << 20});
    const Vec3 sun = local_sun(kLat, kLon, 90, elevation), top = to_cartesian({kLat, kLon, height});
    // Tip of the shadow on the sphere. With curvature: at 2 degrees over flat ground it would be h / tan(el) = 22.9 km.
    const double along = top.dot(sun), root = along * along - (top.squared_norm() - kMoonRadius_m * kMoonRadius_m);
    ASSERT_GT(root, 0);
    const Vec3 tip = top - sun * (along - std::sqrt(root));
    const double length = (tip - to_cartesian({kLat, kLon, 0})).norm();
    EXPECT_GT(length, height / std::tan(elevation * std::numbers::pi / 180));
    // A camera over the tip that sees 2 km around it, and the mountain nowhere near.
    ASSERT_GT(length, 9000);
    const Geographic g = to_geographic(tip);
    FrameRequest request = nadir(g.lat_deg, g.lon_deg, 2000, 128, 90);
    request.sun.direction = sun;
    request.accuracy.max_error_px = 0;
    const Frame frame = renderer.render(request);
    ASSERT_EQ(frame.report.sources.size(), 1U);
    EXPECT_EQ(frame.report.sources[0].name, "tile1") << "the mountain stands on tile2";
    std::size_t shadowed = 0;
    double farthest = 0;
    for (std::size_t i = 0; i < frame.products.lit.size(); ++i) {
      ASSERT_FALSE(std::isnan(frame.products.lit[i]));
      if (frame.products.lit[i] > 0) continue;
      ++shadowed;
      farthest = std::max(farthest, (at3(frame.products.position, i) - to_cartesian({kLat, kLon, 0})).norm());
    }
    EXPECT_GT(shadowed, 30U) << elevation << " degrees: no shadow in view";
    EXPECT_LE(farthest, length + 2) << elevation;
    // Towards its tip the shadow gets narrower than a pixel: at this distance, for a cone; a mesh of a few posts is
    // slimmer.
    const double pixel = 4000.0 / 128,
                 narrow = pixel / (2 * std::tan(elevation * std::numbers::pi / 180) * 606 / height);
    EXPECT_GE(farthest, length - 2 * narrow - 2 * pixel) << elevation;
  }
}

TEST_F(Mountain, TheSameBytesWithOneThreadAndWithTwo) {
  TemporaryFolder folder;
  FrameRequest request = nadir(kLat, kLon - 0.1, 15000, 160, 60);
  request.sun.direction = local_sun(kLat, kLon, 75, 8);
  request.products |= kImage;
  request.accuracy.samples_per_pixel = 4;
  const auto terrain = open(folder, 3000);
  const Renderer one(terrain, {1, std::size_t{512} << 20}), two(terrain, {2, std::size_t{512} << 20});
  const Frame a = one.render(request), b = two.render(request);
  EXPECT_TRUE(same_bytes(a.products, b.products));
  // And whatever was rendered before, by a renderer whose caches hold other things.
  FrameRequest other = request;
  other.pose = nadir(kLat + 0.01, kLon - 0.12, 14000, 160, 60).pose;
  other.products = kDepth;
  const Renderer three(test::open_terrain(folder.path()), {2, std::size_t{64} << 20});
  three.render(other);
  EXPECT_TRUE(same_bytes(a.products, three.render(request).products));
}

// 20 m above a plain or high above it, looking a little up or at the horizon.
FrameRequest outlook(const Vec3& from, double azimuth_deg, double elevation_deg, Visibility visibility) {
  FrameRequest request;
  request.camera = test::square_camera(96, 60);
  request.visibility = visibility;
  request.pose = looking(from, sun_direction(local_axes(from), azimuth_deg, elevation_deg), from);
  request.sun.direction = from.normalized();
  request.products = kRange;
  return request;
}

TEST(LowGround, ItsSkyIsNotMissing) {
  TemporaryFolder folder, east;
  const auto low = [](double, double) { return -2000.0; };
  test::write_global_tile(folder.path(), 1, low);
  test::write_float_tile(east.path(), "east", {12, 21.75, 16, 4 * 16 + 1, 16 * 16 + 1}, low);
  const Renderer whole(test::open_terrain(folder.path()), {2, std::size_t{512} << 20}),
      part(test::open_terrain(east.path()), {2, std::size_t{512} << 20});
  for (const Visibility visibility : {Visibility::zbuffer, Visibility::raytrace}) {
    for (const auto& [height_m, elevation_deg] : {std::pair{-1980.0, 25.0}, {-1980.0, 80.0}, {3000.0, -3.0}}) {
      const FrameRequest request = outlook(to_cartesian({10, 30, height_m}), 60, elevation_deg, visibility);
      const FrameReport seen = whole.render(request).report;
      EXPECT_EQ(seen.missing_fraction, 0) << height_m;
      EXPECT_EQ(seen.hit_fraction > 0, elevation_deg < 50);
      EXPECT_LT(seen.hit_fraction, 0.6);
      // Data end 60 km away, behind which the lowest rays pass below the datum, but not below the ground in view.
      if (height_m < 0) {
        EXPECT_EQ(part.render(request).report.missing_fraction, 0) << elevation_deg;
      }
    }
    // From beside the data every ray is missing that meets the datum or, with them in view, what is as low as they are.
    const Vec3 beside = to_cartesian({10, 20, 3000});
    for (const double azimuth_deg : {90.0, 270.0}) {
      const FrameRequest request = outlook(beside, azimuth_deg, -3, visibility);
      const View view(request.camera, request.pose);
      double meeting = 0;
      for (int i = 0; i < 96 * 96; ++i)
        meeting +=
            test::meet_sphere(beside, view.ray(i % 96, i / 96)->normalized(), azimuth_deg < 180 ? 2000 : 0) ? 1 : 0;
      const FrameReport seen = part.render(request).report;
      EXPECT_EQ(seen.hit_fraction > 0, azimuth_deg < 180);
      EXPECT_NEAR(seen.hit_fraction + seen.missing_fraction, meeting / (96 * 96), 2e-3);
      EXPECT_GT(seen.missing_fraction, 0.4);
    }
  }
}

TEST_F(Mountain, ALandmarkWithoutDataBelow) {
  TemporaryFolder folder;
  const Renderer renderer(open(folder, 3000), {2, std::size_t{512} << 20});
  const FrameRequest r = nadir(12, 30, 200000, 200, 60);
  const std::vector<LandmarkQuery> queries{{12.5, 30, 50000.0}, {11.5, 30, 50000.0}, {12.5, 30, {}}, {11.5, 30, -50.0}};
  for (const double angular_radius_deg : {0.0, 0.25}) {
    const auto marks =
        test::project_landmarks(renderer, r, queries, Sun{local_sun(12, 30, 0, 80), 1, angular_radius_deg});
    EXPECT_TRUE(marks[0].visible && marks[1].visible);
    EXPECT_EQ(marks[0].lit, 1) << "no data below it";
    EXPECT_EQ(marks[1].lit, 1);
    EXPECT_TRUE(std::isnan(marks[2].height_m) && std::isnan(marks[2].lit));
    EXPECT_EQ(marks[3].lit, 0) << "buried";
  }
}

}  // namespace
}  // namespace selenograph::engine
