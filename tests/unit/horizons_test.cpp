// Horizons against closed forms and against brute force in double; shares of discs and runs of nights.
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "dem/base/parallel.h"
#include "engine/horizons/illumination.h"
#include "engine/relief/horizon_plan.h"
#include "tests/support/sample_scenery.h"

namespace selenograph::engine {
namespace {

// Height of the ground in a direction, m.
using Ground = std::function<double(const Vec3&)>;

Relief relief_of(const Ground& ground, const Vec3& centre, double spacing_m, double farthest_m) {
  const ReliefHeights heights = [&](double, std::span<const Vec3> directions, std::span<float> out) {
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = static_cast<float>(ground(directions[i]));
  };
  return Relief({.centre = centre,
                 .half_m = 20,
                 .spacing_m = spacing_m,
                 .farthest_m = farthest_m,
                 .posts_per_distance = kHorizonPostsPerDistance,
                 .void_height_m = kVoidHeight_m},
                heights);
}

// Returns the horizons at the centre of a relief.
std::vector<double> horizons_at_centre(const Relief& relief, int azimuths, double height_above_ground_m) {
  MarchPlaces places{};
  for (int i = 0; i < kPacket; ++i) {
    places.north_y[i] = 1;
    places.east_x[i] = 1;
    places.valid[i] = true;
    places.height[i] = static_cast<float>(relief.height_m(0, 0).value() + height_above_ground_m - relief.reference_m());
  }
  places.on_ground = height_above_ground_m == 0;
  std::vector<float> elevation_deg(static_cast<std::size_t>(azimuths) * kPacket);
  find_horizons(plan_marches(relief, {}), {&places, 1}, azimuths, elevation_deg.data());
  std::vector<double> out;
  for (std::size_t i = 0; i < elevation_deg.size(); i += kPacket) out.push_back(static_cast<double>(elevation_deg[i]));
  return out;
}

// Returns the largest elevation of ground along an azimuth, deg, by samples in double.
double brute_force_deg(const Ground& ground, const Vec3& up, double azimuth_rad, double height_above_ground_m,
                       double step_m, double farthest_m) {
  const EastNorthUp axes = local_axes(up);
  const Vec3 along = std::cos(azimuth_rad) * axes.north + std::sin(azimuth_rad) * axes.east;
  const double eye_m = kMoonRadius_m + ground(up) + height_above_ground_m;
  double tangent = -1e9;
  for (double distance_m = step_m; distance_m < farthest_m; distance_m += step_m) {
    const double angle = distance_m / kMoonRadius_m;
    const double radius_m = kMoonRadius_m + ground(std::cos(angle) * up + std::sin(angle) * along);
    if (!std::isnan(radius_m))
      tangent = std::max(tangent, (radius_m * std::cos(angle) - eye_m) / (radius_m * std::sin(angle)));
  }
  return std::atan(tangent) * kDegreesPerRadian;
}

const Vec3 kSite = to_cartesian({-60, 30, 0}).normalized(), kPole = Vec3(0, 0, -1);

TEST(Horizons, DipOnALevelSphere) {
  for (const Vec3& centre : {kSite, kPole})
    for (const double height_m : {10.0, 300.0}) {
      const Relief relief = relief_of([](const Vec3&) { return -1500.0; }, centre, 20, 6e4);
      const double radius_m = kMoonRadius_m - 1500;
      const double dip_deg = std::acos(radius_m / (radius_m + height_m)) * kDegreesPerRadian;
      for (const double elevation_deg : horizons_at_centre(relief, 24, height_m))
        EXPECT_NEAR(elevation_deg, -dip_deg, kHorizonTolerance_deg + 1e-4);
    }
}

TEST(Horizons, LevelGroundIsItsOwnHorizon) {
  const Relief relief = relief_of([](const Vec3&) { return 0.0; }, kSite, 20, 2e4);
  for (const double elevation_deg : horizons_at_centre(relief, 24, 0)) EXPECT_NEAR(elevation_deg, 0, 1e-4);
}

// A ridge along a great circle, 4 km north of the site, and one behind it that is higher but hidden.
TEST(Horizons, RidgesHideWhatIsBehindThem) {
  const EastNorthUp axes = local_axes(kSite);
  const Ground ground = [&](const Vec3& d) {
    const double north_m = kMoonRadius_m * std::atan2(d.dot(axes.north), d.dot(axes.up));
    const auto ridge = [&](double at_m, double height_m, double width_m) {
      return height_m * std::exp(-std::pow((north_m - at_m) / width_m, 2));
    };
    return ridge(4000, 300, 400) + ridge(9000, 350, 500);
  };
  const Relief relief = relief_of(ground, kSite, 10, 3e4);
  constexpr int kAzimuths = 36;
  const std::vector<double> found_deg = horizons_at_centre(relief, kAzimuths, 0);
  for (int a = 0; a < kAzimuths; ++a) {
    const double azimuth_rad = 2 * std::numbers::pi * a / kAzimuths;
    EXPECT_NEAR(found_deg[static_cast<std::size_t>(a)], brute_force_deg(ground, kSite, azimuth_rad, 0, 2, 3e4), 0.006)
        << a;
  }
  // Toward the ridge the crest's elevation is known in closed form, but for the slope's own maximum before it.
  EXPECT_NEAR(found_deg[0], std::atan(300.0 / 4000) * kDegreesPerRadian, 0.1);
}

// From the middle of a round bowl the horizon is the same everywhere, at a pole as elsewhere.
TEST(Horizons, ABowlIsRoundAtThePolesToo) {
  for (const Vec3& centre : {kSite, kPole, Vec3(0, 0, 1)}) {
    const Ground ground = [&](const Vec3& d) {
      const double distance_m = kMoonRadius_m * angle_between(d, centre);
      return -200 * std::exp(-std::pow(distance_m / 700, 4));
    };
    const double truth_deg = brute_force_deg(ground, centre, 0.3, 0, 0.5, 4000);
    EXPECT_GT(truth_deg, 5);
    for (const double elevation_deg : horizons_at_centre(relief_of(ground, centre, 2, 4000), 72, 0))
      EXPECT_NEAR(elevation_deg, truth_deg, 0.006);
  }
}

// Rough ground with posts 5 m apart, whose places are read from adjacent posts and, as a check, one by one.
TEST(Horizons, PlacesOnALatticeSeeTheSameGround) {
  const EastNorthUp axes = local_axes(kSite);
  const Ground ground = [&](const Vec3& d) {
    const double x_m = kMoonRadius_m * d.dot(axes.east), y_m = kMoonRadius_m * d.dot(axes.north);
    return 3 * std::sin(x_m / 7) * std::cos(y_m / 11) + 40 * std::sin(x_m / 90 + y_m / 130) +
           200 * std::cos(y_m / 2000);
  };
  const ReliefHeights heights = [&](double, std::span<const Vec3> directions, std::span<float> out) {
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = static_cast<float>(ground(directions[i]));
  };
  constexpr double kSpacing_m = 2, kLattice_m = 16, kTurn_rad = 0.4;
  const Relief relief({.centre = kSite,
                       .half_m = 100,
                       .spacing_m = kSpacing_m,
                       .farthest_m = 2e4,
                       .posts_per_distance = kHorizonPostsPerDistance,
                       .turn_rad = kTurn_rad,
                       .lattice_log2 = 3,
                       .void_height_m = kVoidHeight_m},
                      heights);
  const MarchPlan plan = plan_marches(relief, {});
  MarchPlaces places{};
  const Mat3 from_moon = relief.axes();
  for (int i = 0; i < kPacket; ++i) {
    places.x[i] = static_cast<float>((i % 4 - 2) * kLattice_m);
    places.y[i] = static_cast<float>((1 - i / 4) * kLattice_m);
    const Vec3 north = from_moon * axes.north, east = from_moon * axes.east;
    places.north_x[i] = static_cast<float>(north.x());
    places.north_y[i] = static_cast<float>(north.y());
    places.east_x[i] = static_cast<float>(east.x());
    places.east_y[i] = static_cast<float>(east.y());
    places.valid[i] = true;
    places.height[i] =
        static_cast<float>(relief.height_m(static_cast<double>(places.x[i]), static_cast<double>(places.y[i])).value() -
                           relief.reference_m());
  }
  places.spread_m = static_cast<float>(3 * kLattice_m);
  constexpr int kAzimuths = 90;
  const auto horizons = [&](bool on_lattice) {
    places.on_lattice = on_lattice;
    std::vector<float> elevation_deg(std::size_t{kAzimuths} * kPacket);
    find_horizons(plan, {&places, 1}, kAzimuths, elevation_deg.data());
    return elevation_deg;
  };
  const std::vector<float> found = horizons(true), expected = horizons(false);
  for (std::size_t i = 0; i < found.size(); ++i) ASSERT_NEAR(found[i], expected[i], 2e-4) << i;
  // Grids of this relief are also coarser than the lattice, so that patches of posts are read, too.
  EXPECT_GT(relief.grids().size(), 4U);
  const double truth_deg = brute_force_deg(
      ground,
      from_moon.transpose() *
          Vec3(static_cast<double>(places.x[5]), static_cast<double>(places.y[5]), kMoonRadius_m).normalized(),
      0, 0, 0.5, 2e4);
  EXPECT_NEAR(found[5], truth_deg, 0.05);
}

TEST(Horizons, VoidsHaveNoHorizon) {
  const EastNorthUp axes = local_axes(kSite);
  const auto north_m = [&](const Vec3& d) { return kMoonRadius_m * d.dot(axes.north); };
  const Ground ground = [&](const Vec3& d) { return north_m(d) > 3000 ? std::nan("") : 0.02 * north_m(d); };
  const std::vector<double> found_deg = horizons_at_centre(relief_of(ground, kSite, 10, 2e4), 4, 0);
  EXPECT_NEAR(found_deg[0], std::atan(0.02) * kDegreesPerRadian, 0.01);
  EXPECT_NEAR(found_deg[2], -std::atan(0.02) * kDegreesPerRadian, 0.01);
  EXPECT_FALSE(relief_of([](const Vec3&) { return std::nan(""); }, kSite, 10, 2e4).height_m(0, 0).has_value());
}

class HorizonsOfTerrain : public test::SampleScenery {
 protected:
  static dem::MapGrid grid() {
    return {{dem::MapProjection::orthographic, -10.4, 43.9, 0}, -9 * 60.0, 8 * 60.0, 60, 18, 16};
  }
  static HorizonElevations find(const HorizonOptions& options) {
    return scenery().renderer->query(
        nullptr, {}, [&](const RenderContext& context) { return map_horizons(grid(), options, context); });
  }
};

TEST_F(HorizonsOfTerrain, ThreadsChangeNoBit) {
  const HorizonOptions options{.azimuths = 24, .height_above_ground_m = 2, .farthest_m = 1e4};
  std::vector<float> first;
  for (const int threads : {1, 3}) {
    tbb::task_arena arena(threads);
    const std::vector<float> found = in_arena(arena, [&] { return find(options).elevation_deg; });
    if (first.empty()) first = found;
    EXPECT_EQ(found, first);
  }
}

TEST_F(HorizonsOfTerrain, PlacesHaveTheHorizonsOfPixels) {
  const HorizonOptions options{.azimuths = 24, .height_above_ground_m = 0, .farthest_m = 1e4};
  const HorizonElevations map = find(options);
  const Vec3 place = dem::MapTransform(grid().plane).direction(grid().point(7, 5)).value();
  std::vector<float> found;
  scenery().renderer->query(nullptr, {}, [&](const RenderContext& context) {
    return find_place_horizons({&place, 1}, options, context, [&](const PacketHorizons& packet) {
      for (std::size_t i = 0; i < packet.elevation_deg.size(); i += kPacket) found.push_back(packet.elevation_deg[i]);
    });
  });
  ASSERT_EQ(found.size(), 24U);
  for (std::size_t a = 0; a < 24; ++a) EXPECT_NEAR(found[a], map.elevation_deg[(a * 16 + 5) * 18 + 7], 0.02);
}

// --- discs

// Sixteen places with one level horizon.
struct LevelHorizon {
  std::vector<float> elevation_deg;
  PacketHorizons packet;
  LevelHorizon(double horizon_deg, int azimuths) : elevation_deg(static_cast<std::size_t>(azimuths) * kPacket) {
    std::fill(elevation_deg.begin(), elevation_deg.end(), static_cast<float>(horizon_deg));
    for (int i = 0; i < kPacket; ++i) {
      packet.index[i] = i;
      packet.axes[i] = local_axes(kSite);
      packet.radius_m[i] = kMoonRadius_m;
    }
    packet.azimuths = azimuths;
    packet.elevation_deg = elevation_deg;
  }
};

// Returns the share of a disc's light above a chord at height z, in radii, by sums over the disc.
double share_above(double z, double limb_darkening) {
  double above = 0, all = 0;
  constexpr int kSamples = 600;
  for (int i = 0; i < kSamples; ++i)
    for (int j = 0; j < kSamples; ++j) {
      const double x = (2 * i + 1.0) / kSamples - 1, y = (2 * j + 1.0) / kSamples - 1, square = x * x + y * y;
      if (square >= 1) continue;
      const double radiance = 1 - limb_darkening * (1 - std::sqrt(1 - square));
      all += radiance;
      if (y > z) above += radiance;
    }
  return above / all;
}

TEST(DiscShares, OfALevelHorizon) {
  constexpr double kRadius_deg = 0.27;
  const EastNorthUp axes = local_axes(kSite);
  for (const double limb_darkening : {0.0, 0.6})
    for (const double horizon_deg : {-1.0, 12.0})
      for (const double z : {-1.5, -0.9, -0.4, 0.0, 0.3, 0.8, 1.2}) {
        const LevelHorizon level(horizon_deg, 720);
        // A body this far away has no parallax.
        const BodyEpoch body{sun_direction(axes, 359.8, horizon_deg - z * kRadius_deg), 1e15,
                             kRadius_deg * kRadiansPerDegree};
        std::vector<float> share(kPacket);
        find_disc_shares(level.packet, disc_with(limb_darkening), BodyTrack({&body, 1}), share.data());
        const double truth = share_above(z, limb_darkening);
        for (const float found : share) EXPECT_NEAR(found, truth, 0.005) << z;
      }
}

TEST(DiscShares, ParallaxLowersTheEarth) {
  const LevelHorizon level(0, 360);
  const EastNorthUp axes = local_axes(kSite);
  const double distance_m = 3.844e8, parallax_deg = std::asin(kMoonRadius_m / distance_m) * kDegreesPerRadian;
  const BodyEpoch body{sun_direction(axes, 45, parallax_deg), distance_m, 0.016};
  std::vector<float> share(kPacket);
  find_disc_shares(level.packet, disc_with(0), BodyTrack({&body, 1}), share.data());
  EXPECT_NEAR(share[3], 0.5, 0.01);
}

TEST(DiscShares, AHorizonWithoutDataHasNone) {
  LevelHorizon level(0, 360);
  for (std::size_t a = 0; a < 360; ++a) level.elevation_deg[a * kPacket + 5] = std::nanf("");
  level.packet.index[7] = -1;
  const BodyEpoch body{sun_direction(local_axes(kSite), 45, 20), 1e15, 0.005};
  std::vector<float> share(kPacket);
  find_disc_shares(level.packet, disc_with(0), BodyTrack({&body, 1}), share.data());
  EXPECT_TRUE(std::isnan(share[5]));
  EXPECT_TRUE(std::isnan(share[7]));
  EXPECT_EQ(share[4], 1);
}

TEST_F(HorizonsOfTerrain, NightsAndMeansFollowTheSeries) {
  std::vector<std::string> utc;
  for (int day = 1; day <= 28; ++day)
    for (const char* hour : {"00", "12"})
      utc.push_back("2026-02-" + std::string(day < 10 ? "0" : "") + std::to_string(day) + "T" + hour + ":00:00Z");
  const BodySeries bodies = bodies_at(utc, 43200);
  const HorizonOptions options{.azimuths = 90, .height_above_ground_m = 0, .farthest_m = 5000};
  const Vec3 places[] = {dem::MapTransform(grid().plane).direction(grid().point(7, 5)).value(),
                         dem::MapTransform(grid().plane).direction(grid().point(9, 9)).value()};
  scenery().renderer->query(nullptr, {}, [&](const RenderContext& context) {
    const IlluminationSeries series = illumination_of_places(places, options, bodies, context);
    const Illumination map = illumination_of_map(grid(), options, bodies, context);
    EXPECT_EQ(series.sun.size(), 2 * utc.size());
    for (std::size_t place = 0; place < 2; ++place) {
      double sum = 0, run = 0, longest = 0, nights = 0;
      for (std::size_t e = 0; e < utc.size(); ++e) {
        const float share = series.sun[e * 2 + place];
        sum += static_cast<double>(share);
        run = share > 0 ? 0 : run + 1;
        nights += run == 1;
        longest = std::max(longest, run);
      }
      EXPECT_NEAR(series.summary.sun_mean[place], sum / static_cast<double>(utc.size()), 1e-5);
      EXPECT_EQ(series.summary.longest_night_h[place], 12 * longest);
      EXPECT_EQ(series.summary.nights[place], nights);
      EXPECT_GT(longest, 20);
    }
    // At 10 S 44 E the Earth never sets.
    EXPECT_EQ(series.summary.earth_mean[0], 1);
    EXPECT_EQ(series.summary.longest_without_earth_h[0], 0);
    EXPECT_NEAR(map.sun_mean[5 * 18 + 7], series.summary.sun_mean[0], 0.01);
    return 0;
  });
}

}  // namespace
}  // namespace selenograph::engine
