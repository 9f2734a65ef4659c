// Light from terrain and from the Earth, against closed forms.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "engine/indirect/fields_in_view.h"
#include "engine/indirect/sector_sum.h"
#include "engine/indirect/slope_light.h"
#include "engine/radiometry/earth.h"
#include "engine/renderer.h"
#include "engine/scene/selection.h"
#include "engine/sky/ephemeris.h"
#include "engine/visibility/objects/object_mesh.h"
#include "tests/support/effort.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

// A spherical bowl in level ground: Ingersoll, Svitek & Murray, Icarus 100, 40 (1992).
struct Bowl {
  double diameter_m, depth_m;
  Vec3 centre = to_cartesian({10, 20, 0}).normalized();
  EastNorthUp axes = local_axes(centre);
  double radius_m() const { return (diameter_m * diameter_m / 4 + depth_m * depth_m) / (2 * depth_m); }
  Vec3 level(const Vec3& d) const { return Vec3(d.dot(axes.east), d.dot(axes.north), 0) * kMoonRadius_m; }
  double height(const Vec3& d) const {
    const double square = level(d).squared_norm(), r = radius_m();
    return square > diameter_m * diameter_m / 4 ? 0 : r - depth_m - std::sqrt(r * r - square);
  }
  Vec3 normal(const Vec3& d) const {
    const Vec3 at = level(d);
    return (-at.x() * axes.east - at.y() * axes.north + (radius_m() - depth_m - height(d)) * axes.up).normalized();
  }
  // The share of the whole sphere that the bowl is: what each place sees of it.
  double share() const { return 1 / (1 + std::pow(diameter_m / depth_m, 2) / 4); }
  double aperture_m2() const { return std::numbers::pi * diameter_m * diameter_m / 4; }
  Relief relief(double farthest_m) const {
    return Relief({centre, 1.25 * diameter_m, diameter_m / 256, farthest_m},
                  [&](double, std::span<const Vec3> directions, std::span<float> heights) {
                    for (std::size_t i = 0; i < heights.size(); ++i)
                      heights[i] = static_cast<float>(height(directions[i]));
                  });
  }
};

constexpr double kFlux_w_m2 = 1000, kAlbedo = 0.12;

SlopeLightSource lambert_in(const Sun& sun, double albedo = kAlbedo, int bounces = 1) {
  Reflectance lambert;
  lambert.model = ReflectanceModel::lambert, lambert.rho = albedo;
  return {sun, kFlux_w_m2, Brdf(lambert), false, {}, bounces};
}

// check(east and north of the relief's centre in metres, light, integral over the sky) for its posts in steps of
// `stride`.
template <typename Check>
void for_posts(const Relief& relief, const SlopeLight& light, int stride, double within_m, const Check& check) {
  const double spacing_m = relief.shape().spacing_m;
  const int half = static_cast<int>(within_m / spacing_m), middle = relief.middle();
  std::array<SectorLight, kPacket> found;
  for (int row = -half; row <= half; row += stride)
    for (int column = -half; column <= half; column += kPacket * stride) {
      light.gather(middle + row, middle + column, stride, found, {});
      for (int i = 0; i < kPacket; ++i) {
        Vec3 all = Vec3::zero();
        for (const Vec3f& from : found[static_cast<std::size_t>(i)].from) all += from.cast<double>();
        check((column + i * stride) * spacing_m, row * spacing_m, all,
              Vec3(found[static_cast<std::size_t>(i)].sky.cast<double>()));
      }
    }
}

// check(irradiance, share of the hemisphere that is ground, area) for places in a bowl.
template <typename Check>
void for_places(const Bowl& bowl, const Relief& relief, const SlopeLight& light, int stride, double within_m,
                const Check& check) {
  const double side_m = stride * relief.shape().spacing_m;
  for_posts(relief, light, stride, within_m, [&](double east_m, double north_m, const Vec3& arrives, const Vec3& sky) {
    if (std::hypot(east_m, north_m) > within_m) return;
    const Vec3 place = bowl.centre * kMoonRadius_m + east_m * bowl.axes.east + north_m * bowl.axes.north;
    const Vec3 normal = bowl.normal(place.normalized());
    check(arrives.dot(normal), 1 - normal.dot(sky) / std::numbers::pi, side_m * side_m / normal.dot(bowl.axes.up));
  });
}

// F0 sin e0 A f (1 - f) by one bounce, by n 1 + A f + ... + (A f)^(n - 1) times that. A bowl of 200 m: the Moon is flat
// there. Its rim is sharp; cells of 1/96 to 1/48 of the distance cut it.
void expect_the_same_everywhere(const Bowl& bowl, const Relief& relief, double elevation_deg, int bounces) {
  // With more light, to see the second bounce.
  const double albedo = bounces == 1 ? kAlbedo : 0.8, f = bowl.share();
  Sun sun;
  sun.direction = sun_direction(bowl.axes, 70, elevation_deg);
  const SlopeLight light(relief, lambert_in(sun, albedo, bounces));
  const double truth = kFlux_w_m2 * std::sin(elevation_deg * kRadiansPerDegree) * albedo * f * (1 - f) *
                       (1 - std::pow(albedo * f, bounces)) / (1 - albedo * f);
  const bool low = elevation_deg < 15;
  double sum = 0;
  int count = 0;
  for (const int stride : {2, 4})
    for_places(bowl, relief, light, stride, 95, [&](double irradiance, double ground, double) {
      EXPECT_NEAR(ground, f, 0.01);
      EXPECT_NEAR(irradiance, truth, (low ? 0.052 : 0.03) * truth);
      sum += irradiance, ++count;
    });
  EXPECT_GT(count, 5000);
  EXPECT_NEAR(sum / count, truth, (low || bounces > 1 ? 0.0115 : 0.0075) * truth);
}

TEST(IndirectLight, ABounceInABowlIsTheSameEverywhere) {
  for (const double ratio : {5.0, 8.0, 14.0}) {
    if (ratio == 8 && !test::full_effort()) continue;
    const Bowl bowl{200, 200 / ratio};
    const Relief relief = bowl.relief(2000);
    for (const auto& [elevation_deg, bounces] : {std::pair(10.0, 1), {20.0, 1}, {40.0, 1}, {30.0, 2}, {30.0, 3}}) {
      // Low and high Suns for the shallow one, where they graze; the rest for the deep one, which has more light to
      // pass on.
      const bool of_shallow = elevation_deg == 10 || elevation_deg == 40;
      if (of_shallow != (ratio == 14) && !test::full_effort()) continue;
      SCOPED_TRACE(::testing::Message() << ratio << " " << elevation_deg << " " << bounces);
      expect_the_same_everywhere(bowl, relief, elevation_deg, bounces);
    }
  }
}

// A map of one value is as the model with that value, by two bounces, too, whatever the map's model has of its own.
TEST(IndirectLight, AMapOfOneAlbedoIsAsTheModels) {
  const Bowl bowl{200, 40};
  const Relief relief = bowl.relief(2000);
  Sun sun;
  sun.direction = sun_direction(bowl.axes, 70, 30);
  const auto hapke = [](double w) {
    Reflectance of{.model = ReflectanceModel::hapke};
    of.hapke.w = w;
    return Brdf(of);
  };
  struct Case {
    bool is_w;
    int bounces;
    float within;
  };
  // Diffuse light of a w is interpolated.
  for (const auto& [is_w, bounces, within] : {Case{true, 1, 1e-5F}, {true, 2, 1e-3F}, {false, 2, 1e-5F}}) {
    SCOPED_TRACE(::testing::Message() << is_w << " " << bounces);
    const double albedo = is_w ? 0.6 : 0.8;
    SlopeLightSource plain = lambert_in(sun, albedo, bounces), mapped = lambert_in(sun, 1, bounces);
    if (is_w) plain.brdf = hapke(albedo), mapped.brdf = hapke(0.3);
    mapped.albedo_is_w = is_w;
    mapped.albedo = [&](double, std::span<const Vec3>, std::span<float> out, const StopToken&) {
      std::fill(out.begin(), out.end(), static_cast<float>(albedo));
    };
    const SlopeLight by_model(relief, plain), by_map(relief, mapped);
    std::array<SectorLight, kPacket> found, expected;
    by_model.gather(relief.middle() + 20, relief.middle() - 40, 4, expected, {});
    by_map.gather(relief.middle() + 20, relief.middle() - 40, 4, found, {});
    for (std::size_t i = 0; i < kPacket; ++i)
      for (std::size_t k = 0; k < kSectors; ++k)
        EXPECT_LT((found[i].from[k] - expected[i].from[k]).norm(), within * expected[i].from[k].norm());
    const float given_back = by_model.radiosity(relief.middle(), relief.middle(), {});
    EXPECT_GT(given_back, 0);
    EXPECT_NEAR(by_map.radiosity(relief.middle(), relief.middle(), {}), given_back, within * given_back);
  }
}

// The second Sun finds the views of the first, and gets the light of a relief that keeps none, to the bit.
TEST(IndirectLight, KeptViewsOfTheGroundServeOtherSuns) {
  const Bowl bowl{200, 40};
  const Relief relief = bowl.relief(2000);
  GroundViewStore::Views views(std::size_t{64} << 20);
  for (const double azimuth_deg : {70.0, 200.0})
    for (const int bounces : {1, 3}) {
      Sun sun;
      sun.direction = sun_direction(bowl.axes, azimuth_deg, 25);
      const SlopeLight keeping(relief, lambert_in(sun, 0.8, bounces), {&views, {1, 2}}),
          other(relief, lambert_in(sun, 0.8, bounces));
      std::array<SectorLight, kPacket> found, expected;
      for (const int stride : {1, 2, 4}) {
        keeping.gather(relief.middle() + 20, relief.middle() - 40, stride, found, {}, true);
        other.gather(relief.middle() + 20, relief.middle() - 40, stride, expected, {});
        for (std::size_t i = 0; i < kPacket; ++i) {
          EXPECT_EQ(found[i].sky, expected[i].sky);
          float light = 0;
          for (std::size_t k = 0; k < kSectors; ++k) {
            EXPECT_EQ(found[i].from[k], expected[i].from[k]);
            light += found[i].from[k].norm();
          }
          EXPECT_GT(light, 0);
        }
      }
      EXPECT_EQ(views.misses(), 3U);
    }
  EXPECT_EQ(views.hits(), 9U);
}

// What enters by the aperture leaves the ground A times, of which the ground receives the share f.
TEST(IndirectLight, ABowlReceivesTheEnergyThatItReflects) {
  for (const double ratio : {5.0, 8.0}) {
    const Bowl bowl{200, 200 / ratio};
    const Relief relief = bowl.relief(2000);
    Sun sun;
    sun.direction = sun_direction(bowl.axes, 30, 40);
    const SlopeLight light(relief, lambert_in(sun, 1));
    double sum = 0, area = 0;
    for_places(bowl, relief, light, 4, bowl.diameter_m / 2,
               [&](double irradiance, double, double m2) { sum += irradiance * m2, area += m2; });
    // The lattice's share of the bowl, whose border it follows in squares.
    const double lattice = area * (1 - bowl.share()) / bowl.aperture_m2();
    EXPECT_NEAR(lattice, 1, 0.01);
    const double enters = kFlux_w_m2 * std::sin(40 * kRadiansPerDegree) * bowl.aperture_m2();
    EXPECT_NEAR(sum / lattice, enters * bowl.share(), 0.0075 * enters * bowl.share()) << ratio;
  }
}

// Two long plane walls that meet at the bottom of a trench; of 45 degrees, they are perpendicular. A place x metres
// from the edge sees the other wall, L wide, as the strip from its own wall's line to the direction of the upper edge:
// the view factor is (1 + (L cos a - x) / sqrt(x^2 + L^2 - 2 x L cos a)) / 2, a being the angle between the walls. Its
// mean over a wall is Hottel's 1 - sin(a / 2). Closed forms for discs are of discs that face each other: no heights.
TEST(IndirectLight, WallsOfATrenchLightEachOther) {
  struct Case {
    double slope_deg, sun_deg, east_of_north_deg, within, near_edge;
  };
  for (const Case& c : {Case{15, 40, 0, 0.011, 0.035},
                        {25, 40, 0, 0.011, 0.035},
                        {45, 60, 0, 0.011, 0.035},
                        {45, 60, -45, 0.024, 0.04}}) {
    constexpr double kHalfWidth_m = 500;
    const double slope = std::tan(c.slope_deg * kRadiansPerDegree), stretch = std::hypot(1, slope);
    const Vec3 centre = to_cartesian({-30, 100, 0}).normalized();
    const EastNorthUp axes = local_axes(centre);
    const double turn = c.east_of_north_deg * kRadiansPerDegree;
    const Vec3 across = std::cos(turn) * axes.east - std::sin(turn) * axes.north;
    const auto across_m = [&](const Vec3& d) { return d.dot(across) / d.dot(axes.up) * kMoonRadius_m; };
    const Relief relief(
        {centre, 1500, 4, 60000}, [&](double, std::span<const Vec3> directions, std::span<float> heights) {
          for (std::size_t i = 0; i < heights.size(); ++i)
            heights[i] = static_cast<float>(-slope * std::max(kHalfWidth_m - std::abs(across_m(directions[i])), 0.0));
        });
    Sun sun;
    sun.direction = sun_direction(axes, 90 + c.east_of_north_deg, c.sun_deg);
    const SlopeLight light(relief, lambert_in(sun));
    const auto normal_at = [&](double place_m) {
      return (-std::copysign(slope, place_m) * across + axes.up).normalized();
    };
    const double cosine = std::cos((180 - 2 * c.slope_deg) * kRadiansPerDegree), wide = kHalfWidth_m * stretch;
    int count = 0;
    double ours = 0, truths = 0;
    for_posts(relief, light, 4, 480, [&](double east_m, double north_m, const Vec3& arrives, const Vec3&) {
      const double place_m = east_m * std::cos(turn) - north_m * std::sin(turn), way_m = std::abs(place_m);
      if (way_m < 40 || way_m > 480) return;
      const double x = way_m * stretch,
                   sees = (1 + (wide * cosine - x) / std::sqrt(x * x + wide * wide - 2 * x * wide * cosine)) / 2;
      const double truth = kFlux_w_m2 * normal_at(-place_m).dot(sun.direction) * kAlbedo * sees;
      const double found = arrives.dot(normal_at(place_m));
      // From near an edge, cells of the other one mix wall and plateau.
      EXPECT_NEAR(found, truth, (way_m > 400 ? c.near_edge : c.within) * truth) << c.slope_deg << " " << place_m;
      ours += found, truths += truth, ++count;
    });
    EXPECT_NEAR(ours / truths, 1, 0.0075);
    EXPECT_GT(count, 500);
  }
}

// A wall whose upper edge is the border of the data, and level ground that it lights: the wall is a strip under
// elevations of 0 to e, with the view factor (1 - cos e) / 2.
TEST(IndirectLight, LightComesFromTheLastPostsOfTheData) {
  constexpr double kFoot_m = 200, kTop_m = 400, kSlope = 0.5, kAlong_m = 4000;
  const Vec3 centre = to_cartesian({0, 40, 0}).normalized();
  const EastNorthUp axes = local_axes(centre);
  const auto height_at = [&](const Vec3& direction) {
    const double east_m = direction.dot(axes.east) / direction.dot(axes.up) * kMoonRadius_m;
    return east_m > kTop_m + 1 ? std::nanf("") : static_cast<float>(kSlope * std::max(east_m - kFoot_m, 0.0));
  };
  const Relief relief({centre, 40, 4, kAlong_m},
                      [&](double, std::span<const Vec3> directions, std::span<float> heights) {
                        std::transform(directions.begin(), directions.end(), heights.begin(), height_at);
                      });
  Sun sun;
  sun.direction = sun_direction(axes, 270, 40);
  const SlopeLight light(relief, lambert_in(sun));
  const Vec3 normal_of_wall = (axes.up - kSlope * axes.east).normalized();
  const double radiosity = kFlux_w_m2 * kAlbedo * normal_of_wall.dot(sun.direction);
  double found = 0, truth = 0;
  for_posts(relief, light, 1, 20, [&](double east_m, double, const Vec3& arrives, const Vec3&) {
    const double elevation = std::atan(kSlope * (kTop_m - kFoot_m) / (kTop_m - east_m));
    found += arrives.dot(axes.up);
    truth += radiosity * (1 - std::cos(elevation)) / 2;
  });
  EXPECT_NEAR(found, truth, 0.02 * truth);
}

TEST(IndirectLight, DiffuseAlbedo) {
  Reflectance reflectance{.model = ReflectanceModel::lambert, .rho = 0.12};
  EXPECT_NEAR(diffuse_albedo(Brdf(reflectance)), 0.12, 1e-6);
  // mu0 f_r = rho / pi mu0 / (mu0 + mu): 4 rho times the integral of mu0 mu / (mu0 + mu), (2 - 2 ln 2) / 3.
  reflectance = {.model = ReflectanceModel::lommel_seeliger, .rho = 0.12, .phase = PhaseLaw::none};
  const double found = diffuse_albedo(Brdf(reflectance)), one = Brdf(reflectance).times_mu0(1, 1, 1) * 2;
  EXPECT_NEAR(found, one * 4 * std::numbers::pi * (2 - 2 * std::numbers::ln2) / 3, 2e-3 * found);
}

// 0.084 W m-2 at full Earth over all wavelengths; at quarter Earth by the phase law 10^(-0.4 * 1.568).
TEST(IndirectLight, TheEarthFollowsItsPhaseLaw) {
  Sun sun;
  sun.direction = -Vec3::unit_x();
  const Earth full{Vec3::unit_x()}, quarter{Vec3::unit_y()};
  EXPECT_NEAR(1361 * earth_over_sun(full, sun, nullptr), 0.084, 0.002);
  EXPECT_NEAR(earth_over_sun(quarter, sun, nullptr) / earth_over_sun(full, sun, nullptr), 0.236, 0.001);
  EXPECT_NEAR(earth_radius_deg(384.4e6), 0.951, 0.001);
}

// Librations are at most 8 degrees.
TEST(IndirectLight, TheEarthIsOverTheNearSide) {
  for (const char* utc : {"2026-01-07T03:00:00Z", "2026-06-15T12:00:00Z", "2027-11-25T00:00:00Z"}) {
    const Earth earth = earth_at(utc);
    EXPECT_GT(earth.direction.x(), std::cos(11 * kRadiansPerDegree)) << utc;
    EXPECT_GT(earth.distance_m, 355e6) << utc;
    EXPECT_LT(earth.distance_m, 408e6) << utc;
  }
}

// A Lambert frame with and without: the difference is irradiance times rho / pi.
TEST(IndirectLight, WhatAFrameGainsIsItsIrradiance) {
  const test::TemporaryFolder folder;
  test::write_float_tile(folder / "dem", "wall", {2, 10, 64, 129, 129}, [](double lat, double lon) {
    return 4000 * std::exp(-std::pow((lon - 11) / 0.1, 2)) + 100 * std::sin(40 * lat);
  });
  const Renderer renderer(test::open_terrain(folder / "dem"), RendererOptions{2, std::size_t{256} << 20});
  FrameRequest request;
  request.camera = test::square_camera(96, 50);
  const Vec3 eye = to_cartesian({1, 10.85, 20000});
  request.pose = test::looking(eye, -eye, Vec3::unit_z());
  request.sun.direction = sun_direction(local_axes(1, 10.85), 270, 20);
  request.reflectance = {.model = ReflectanceModel::lambert, .rho = 0.12};
  request.products = kRadiance | kIrradiance;
  const Frame without = renderer.render(request);
  request.indirect.terrain = true;
  const Frame with = renderer.render(request), again = renderer.render(request);
  EXPECT_EQ(with.products.radiance, again.products.radiance);
  EXPECT_EQ(with.products.irradiance, again.products.irradiance);
  double most = 0;
  for (std::size_t i = 0; i < with.products.radiance.size(); ++i) {
    const double gain =
                     static_cast<double>(with.products.radiance[i]) - static_cast<double>(without.products.radiance[i]),
                 arrives = static_cast<double>(with.products.irradiance[3 * i + 1]);
    if (std::isnan(arrives)) continue;
    EXPECT_NEAR(gain, arrives * 0.12 / std::numbers::pi, 1e-5 * static_cast<double>(with.products.radiance[i]) + 1e-6);
    most = std::max(most, arrives);
  }
  EXPECT_GT(most, 5);
}

std::shared_ptr<const ObjectMesh> tetrahedron() {
  ObjectShape shape;
  for (const Vec3& place : {Vec3(0, 0, -1), Vec3(1, 1, 1), Vec3(-1, 1, 1), Vec3(0, -1, 1)})
    shape.corners.push_back({place.cast<float>(), Vec3f::zero()});
  shape.triangles = {{{0, 1, 2}, 0}, {{0, 2, 3}, 0}, {{0, 3, 1}, 0}, {{1, 3, 2}, 0}}, shape.parts = {"all"};
  return std::make_shared<const ObjectMesh>(shape);
}

// Before the sky, in views that see the ground below it or not.
TEST(IndirectLight, GroundOutOfViewLightsAnObject) {
  const test::TemporaryFolder folder;
  test::write_float_tile(folder / "dem", "rough", {2, 10, 64, 129, 129},
                         [](double lat, double lon) { return 300 * std::sin(120 * lat) * std::sin(40 * lon + lat); });
  const Renderer renderer(test::open_terrain(folder / "dem"), RendererOptions{2, std::size_t{512} << 20});
  for (const double size_m : {10.0, 200.0}) {
    const Vec3 middle = to_cartesian({1, 11, 2000}), eye = to_cartesian({0.9, 11, 1500});
    FrameRequest request;
    request.pose = test::looking(eye, middle - eye, middle);
    request.sun.direction = sun_direction(local_axes(1, 11), 250, 30);
    request.products = kIrradiance | kObjectId;
    request.indirect.terrain = true;
    request.objects = {{tetrahedron(), middle, request.pose.camera_from_moon.conjugate(), size_m, {{}}}};
    std::vector<double> lights;
    for (const int times : {1, 9}) {
      const double half = times * std::tan(3 * test::kDegree);
      request.camera = test::square_camera(64 * times, 2 * std::atan(half) / test::kDegree);
      const FrameProducts found = renderer.render(request).products;
      double sum = 0, pixels = 0;
      for (std::size_t i = 0; i < found.object_id.size(); ++i)
        if (found.object_id[i] == 0) sum += static_cast<double>(found.irradiance[3 * i + 1]), ++pixels;
      lights.push_back(sum / pixels);
    }
    EXPECT_GT(lights.back(), 5);
    EXPECT_NEAR(lights.front(), lights.back(), 0.06 * lights.back()) << size_m;
  }
}

// Posts are gathered where a frame needs them: what a narrow view shows is as the middle of a wide one. Mountains rise
// into the view; the ground below an object is beside it.
TEST(IndirectLight, ANarrowViewHasAllPostsThatItNeeds) {
  const test::TemporaryFolder folder;
  const auto rough = [](double lat, double lon) {
    return 900 * std::sin(9 * lat) * std::cos(70 * lon) + 700 * std::sin(120 * lat) * std::sin(40 * lon + lat);
  };
  test::write_float_tile(folder / "dem", "middle", {2, 10, 64, 129, 129}, rough);
  test::write_float_tile(folder / "dem", "around", {6, 6, 16, 129, 129}, rough);
  test::write_float_tile(folder / "dem", "pole", {90, -180, 16, 65, 5761}, [](double lat, double lon) {
    return 500 * std::sin(150 * lat) * std::cos(4 * lon * test::kDegree) * std::min(1.0, 90 - lat);
  });
  const Renderer renderer(test::open_terrain(folder / "dem"), RendererOptions{2, std::size_t{512} << 20});
  const auto mesh = tetrahedron();
  struct Look {
    double lat_deg, lon_deg, height_m, off_nadir_deg;
  };
  constexpr int kNarrow = 48, kWide = 3 * kNarrow;
  for (const Look& look : {Look{1, 11, 20000, 0},
                           {1.02, 10.97, 2500, 0},
                           {1.5, 10.4, 6000, 70},
                           {2.0, 11.4, 12000, 55},
                           {89.9, 30, 15000, 0},
                           {90, 0, 30000, 50}}) {
    SCOPED_TRACE(::testing::Message() << look.lat_deg << " " << look.height_m << " " << look.off_nadir_deg);
    FrameRequest request;
    const Vec3 eye = to_cartesian({look.lat_deg, look.lon_deg, look.height_m});
    const EastNorthUp axes = local_axes(eye.normalized());
    const double tilt = look.off_nadir_deg * test::kDegree;
    const Vec3 boresight = std::sin(tilt) * axes.north - std::cos(tilt) * axes.up;
    request.pose = test::looking(eye, boresight, axes.north + axes.up);
    request.sun.direction = sun_direction(axes, 250, 20);
    request.products = kIrradiance | kObjectId;
    request.indirect.terrain = true;
    const double half = std::tan(8 * test::kDegree);
    const Quat moon_from_camera = request.pose.camera_from_moon.conjugate();
    const Vec3 corner = moon_from_camera * Vec3(0.8 * half, 0.8 * half, 1);
    SceneObject object{mesh, eye + 0.4 * look.height_m * corner, moon_from_camera, 0.02 * look.height_m, {{}}};
    request.objects = {object};
    request.camera = test::square_camera(kNarrow, 16);
    const Frame narrow = renderer.render(request);
    request.camera = test::square_camera(kWide, 2 * std::atan(3 * half) / test::kDegree);
    const Frame wide = renderer.render(request);
    int lit = 0, on_object = 0;
    for (int y = 0; y < kNarrow; ++y)
      for (int x = 0; x < kNarrow; ++x) {
        const auto here = static_cast<std::size_t>(y * kNarrow + x),
                   there = static_cast<std::size_t>((y + kNarrow) * kWide + x + kNarrow);
        const float found = narrow.products.irradiance[3 * here + 1], truth = wide.products.irradiance[3 * there + 1];
        if (std::isnan(found) || std::isnan(truth)) continue;
        EXPECT_NEAR(found, truth, 1e-3F * truth + 1e-4F) << x << " " << y;
        lit += truth > 1e-3F, on_object += narrow.products.object_id[here] == 0;
      }
    EXPECT_GT(lit, kNarrow * kNarrow / 8);
    EXPECT_GT(on_object, 0);
  }
}

// In the middle of an image and in its corners, where ground is seen obliquely and from farther away: level ground that
// is seen from above has pixels of one size. Posts of the finest mesh are 59 m apart, those of light at most eight
// times, and at least half of it where less than a pixel is asked for.
TEST(IndirectLight, PostsAreAsFarApartAsAskedFor) {
  const test::TemporaryFolder folder;
  test::write_float_tile(folder / "dem", "level", {2, 10, 512, 1025, 1025}, [](double, double) { return 0.0; });
  const auto terrain = test::open_terrain(folder / "dem");
  constexpr double kHeight_m = 20000;
  constexpr int kSide = 512;
  const Vec3 eye = to_cartesian({1, 11, kHeight_m});
  for (const double fov_deg : {10.0, 70.0})
    for (const double max_error_px : {0.0, 4.0}) {
      const double pixel_m = 2 * kHeight_m * std::tan(fov_deg / 2 * test::kDegree) / kSide;
      const RowViews views(test::square_camera(kSide, fov_deg), test::looking(eye, -eye, Vec3::unit_z()), std::nullopt);
      const Selection selection =
          select_for_view(*terrain, views.reference(), nullptr, {.max_error_px = max_error_px}, {});
      const Mesh mesh(*terrain, selection.blocks);
      for (const double posts_m : {30.0, 100.0, 200.0, 300.0, 540.0}) {
        if (posts_m < 59 && (max_error_px > 0 || posts_m > pixel_m)) continue;
        SCOPED_TRACE(::testing::Message() << fov_deg << " " << max_error_px << " " << posts_m);
        const FieldsInView seen = fields_in_view({views, mesh, {}, {}}, *terrain, posts_m / pixel_m);
        ASSERT_GT(seen.tiles(), 0U);
        for (const FieldsInView::Field& field : seen.fields) {
          if (field.tiles.empty()) continue;
          EXPECT_GT(field.plane.spacing_m(), 0.45 * posts_m);
          EXPECT_LT(field.plane.spacing_m(), 1.2 * posts_m);
        }
      }
    }
}

// Level ground west of a meridian, waves of 8 posts east of it. In pixels as large as a post the waves have posts of
// light of a pixel, level ground of four. From farther away, where the mesh is coarser than the posts, all have four.
TEST(IndirectLight, RoughGroundHasPostsAPixelApart) {
  const test::TemporaryFolder folder;
  constexpr double kPostsPerDegree = 512, kMiddle_deg = 11, kHeight_m = 10000;
  test::write_float_tile(folder / "dem", "half", {2, 10, kPostsPerDegree, 1025, 1025}, [](double lat, double lon) {
    const double phase = kPostsPerDegree / 4 * std::numbers::pi;
    return lon > kMiddle_deg ? 30 * std::sin(phase * lat) * std::sin(phase * lon) : 0.0;
  });
  const auto terrain = test::open_terrain(folder / "dem");
  const double post_m = kMoonRadius_m * test::kDegree / kPostsPerDegree;
  const Vec3 eye = to_cartesian({1, kMiddle_deg, kHeight_m});
  for (const double posts_per_px : {1.0, 4.0}) {
    constexpr int kSide = 128;
    const double pixel_m = posts_per_px * post_m,
                 fov_deg = 2 * std::atan(kSide / 2 * pixel_m / kHeight_m) / test::kDegree;
    const RowViews views(test::square_camera(kSide, fov_deg), test::looking(eye, -eye, Vec3::unit_z()), std::nullopt);
    const double max_error_px = posts_per_px > 1 ? 4 : 0;
    const Selection selection =
        select_for_view(*terrain, views.reference(), nullptr, {.max_error_px = max_error_px}, {});
    const Mesh mesh(*terrain, selection.blocks);
    const FieldsInView seen = fields_in_view({views, mesh, {}, {}}, *terrain, 4);
    int rough_blocks = 0, level_blocks = 0;
    for (std::size_t i = 0; i < mesh.blocks().size(); ++i) {
      const dem::BlockExtent& e = mesh.blocks()[i].posts->extent;
      const double west_deg = dem::lon_deg_of(e.lon0), east_deg = dem::lon_deg_of(e.lon1());
      if (seen.field_of_block[i] < 0 || (west_deg < kMiddle_deg && east_deg > kMiddle_deg)) continue;
      const bool rough = west_deg >= kMiddle_deg;
      const double spacing_px =
          seen.fields[static_cast<std::size_t>(seen.field_of_block[i])].plane.spacing_m() / pixel_m;
      EXPECT_GT(spacing_px, rough && posts_per_px == 1 ? 0.5 : 1.9) << west_deg << " " << posts_per_px;
      EXPECT_LT(spacing_px, rough && posts_per_px == 1 ? 1.2 : 4.8) << west_deg << " " << posts_per_px;
      ++(rough ? rough_blocks : level_blocks);
    }
    EXPECT_GT(rough_blocks, 0);
    EXPECT_GT(level_blocks, 0);
  }
}

// The Sun moves by 1.4e-5 degrees between frames of a loop at 10 Hz: the light is gathered once for many of them.
// Within half a step of the lattice, 0.02 degrees at a low Sun, it is the same; a step later it has changed, by little.
TEST(IndirectLight, ASunThatMovesALittleFindsTheSameLight) {
  const test::TemporaryFolder folder;
  test::write_float_tile(folder / "dem", "wall", {2, 10, 64, 129, 129},
                         [](double, double lon) { return 4000 * std::exp(-std::pow((lon - 11) / 0.1, 2)); });
  const Renderer renderer(test::open_terrain(folder / "dem"), RendererOptions{2, std::size_t{256} << 20});
  FrameRequest request;
  request.camera = test::square_camera(64, 50);
  const Vec3 eye = to_cartesian({1, 10.85, 20000});
  request.pose = test::looking(eye, -eye, Vec3::unit_z());
  request.products = kIrradiance, request.indirect.terrain = true;
  const auto from_terrain = [&](double sun_lon_deg) {
    request.sun.direction = to_cartesian({0, sun_lon_deg, 0}).normalized();
    const Frame frame = renderer.render(request);
    double sum = 0;
    for (std::size_t i = 1; i < frame.products.irradiance.size(); i += 3)
      if (!std::isnan(frame.products.irradiance[i])) sum += static_cast<double>(frame.products.irradiance[i]);
    return sum;
  };
  struct Case {
    double lon_deg, step_deg;
  };
  for (const Case& c : {Case{-77, 0.02}, {-60, 0.08}}) {  // 2 and 19 degrees high
    const double light = from_terrain(c.lon_deg);
    EXPECT_GT(light, 0);
    EXPECT_EQ(from_terrain(c.lon_deg - 0.48 * c.step_deg), light);
    EXPECT_EQ(from_terrain(c.lon_deg + 0.48 * c.step_deg), light);
    const double next = from_terrain(c.lon_deg + 0.52 * c.step_deg);
    EXPECT_NE(next, light);
    EXPECT_NEAR(next, light, 0.015 * light);
  }
}

// Another order of the additions loses the ones beside the large numbers.
TEST(SectorSum, HasOneOrder) {
  const float values[] = {0x1p30F, 1, -0x1p30F, 1, 0, 2, 0, 4};
  EXPECT_EQ(sum_of_sectors(values), 8);
}

}  // namespace
}  // namespace selenograph::engine
