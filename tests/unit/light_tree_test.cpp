// Who can shade whom: conservative against brute force, and not useless.
#include "engine/scene/light_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "dem/terrain/terrain.h"
#include "engine/frame/sun.h"

namespace selenograph::engine {
namespace {

dem::BlockId block(int level, double lat, double lon) {
  return dem::block_at(level, static_cast<dem::Tick>((lat + 90) * dem::kTicksPerDegree),
                       dem::wrap_lon(std::llround((lon + 180) * dem::kTicksPerDegree)));
}

Sun point(const Vec3& direction) {
  Sun sun;
  sun.direction = direction;
  return sun;
}

// The Sun at an azimuth (from north, clockwise) and elevation over a place.
Vec3 sun_over(double lat, double lon, double azimuth_deg, double elevation_deg) {
  return sun_direction(local_axes(lat, lon), azimuth_deg, elevation_deg);
}

TEST(NodeBoundsTest, ContainEveryPlaceOfTheBlock) {
  std::mt19937 random(8);
  std::uniform_real_distribution<double> any(0, 1);
  for (int level = 2; level <= 14; ++level)
    for (const double lat : {-89.9999, -83.0, -76.5, 0.1, 45.0, 77.9, 88.2, 89.9999}) {
      const dem::BlockId id = block(level, lat, 100 * any(random));
      const NodeBounds b = bounds_of(id, -3000, 4000);
      const dem::BlockExtent e = dem::extent_of(id);
      for (int i = 0; i < 500; ++i) {
        const double y = dem::lat_deg_of(e.lat0) +
                         (dem::lat_deg_of(e.lat1()) - dem::lat_deg_of(e.lat0)) * (i % 4 ? any(random) : 0.0);
        const double x = dem::lon_deg_of(e.lon0) + (dem::lon_deg_of(e.lon1()) - dem::lon_deg_of(e.lon0)) * any(random);
        const Vec3 p = to_cartesian({y, x, i % 2 ? -3000 + 7000 * any(random) : 4000});
        ASSERT_LE((p - b.centre).norm(), b.radius_m + 1e-6) << dem::to_string(id);
        // And the box around the points, grown by the bulge, in any direction: what the light grid relies on.
        const Vec3 axis = Vec3(any(random) - 0.5, any(random) - 0.5, any(random) - 0.5).normalized();
        double low = 1e300, high = -1e300;
        for (const Vec3& q : b.points) low = std::min(low, axis.dot(q)), high = std::max(high, axis.dot(q));
        ASSERT_GE(axis.dot(p), low - b.bulge_m - 1e-6) << dem::to_string(id);
        ASSERT_LE(axis.dot(p), high + b.bulge_m + 1e-6) << dem::to_string(id);
      }
    }
}

TEST(NodeBoundsTest, HiddenOnlyBehindTheSolidMoon) {
  std::mt19937 random(9);
  std::uniform_real_distribution<double> any(0, 1);
  std::size_t hidden = 0;
  for (int i = 0; i < 20000; ++i) {
    const double h = std::pow(10, 6 * any(random));
    const Vec3 from = to_cartesian({0, 0, h});
    const NodeBounds b = bounds_of(block(3 + i % 8, 60 * any(random), 160 * any(random)), 0, 9000 * any(random));
    if (!below_horizon(from, b)) continue;
    ++hidden;
    // No line from the viewer to any point may pass outside of the core.
    for (const Vec3& p : b.points) {
      const Vec3 d = (p - from).normalized();
      const double along = -from.dot(d);
      ASSERT_TRUE(along > 0 && along < (p - from).norm() &&
                  (from + along * d).norm() < kMoonRadius_m + dem::kLowestRelief_m);
    }
  }
  EXPECT_GT(hidden, 2000U);
}

TEST(LightTree, MountainShadowsWhatItReaches) {
  // At 2 degrees the shadow of a 5 km top would leave the sphere: the horizon seen from there dips by 4.3 degrees.
  for (const auto& [elevation, h] : {std::pair(2.0, 800.0), std::pair(5.0, 5000.0), std::pair(15.0, 5000.0)}) {
    const Vec3 sun = sun_over(10, 30, 90, elevation);
    const Vec3 top = to_cartesian({10, 30, h});
    // Where the shadow of the top falls: go down-sun until the sphere is met.
    const double along = top.dot(sun), root = along * along - (top.squared_norm() - kMoonRadius_m * kMoonRadius_m);
    ASSERT_GT(root, 0);
    const Geographic tip = to_geographic(top - sun * (along - std::sqrt(root)));
    LightTree receivers(point(sun), top);
    receivers.add_receiver(bounds_of(block(10, tip.lat_deg, tip.lon_deg), -10, 10), 0.25);
    receivers.finish();
    EXPECT_EQ(receivers.shaded_pixels_per_metre(bounds_of(block(10, 10, 30), 0, h)), 0.25) << elevation;
    EXPECT_EQ(receivers.shaded_pixels_per_metre(bounds_of(block(10, 14, 30), 0, h)), 0) << "beside the light";
    EXPECT_EQ(receivers.shaded_pixels_per_metre(bounds_of(block(10, 10, tip.lon_deg - 2), 0, h)), 0)
        << "down-sun of the receiver";
    EXPECT_EQ(receivers.shaded_pixels_per_metre(bounds_of(block(10, 10, 30), 0, 0.5 * h)), 0) << "too low";
  }
}

TEST(LightTree, FindsEveryOccluder) {
  std::mt19937 random(10);
  std::uniform_real_distribution<double> any(0, 1);
  const Vec3 sun = sun_over(-40, 120, 250, 3);
  // Whatever is taken for upwards: nobody, the right one, the Sun itself, anything.
  for (const Vec3& up : {Vec3(Vec3::zero()), to_cartesian({-39, 121, 0}), sun, Vec3(1, -2, 3)}) {
    std::vector<NodeBounds> places;
    LightTree receivers(point(sun), up);
    for (int i = 0; i < 40; ++i) {
      places.push_back(bounds_of(block(8, -40 + 3 * any(random), 120 + 3 * any(random)), -2000, 1000));
      receivers.add_receiver(places.back(), 1 + i);
    }
    receivers.finish();
    std::size_t shaded = 0;
    for (int i = 0; i < 20000; ++i) {
      const NodeBounds caster = bounds_of(block(8, -44 + 10 * any(random), 112 + 14 * any(random)), -2000, 6000);
      const double answer = receivers.shaded_pixels_per_metre(caster);
      for (std::size_t k = 0; k < places.size(); ++k) {
        const Vec3& from = places[k].points[static_cast<std::size_t>(random() % 18)];
        const Vec3 to = caster.centre - from;
        const double along = to.dot(sun), off = (to - along * sun).norm();
        // The ray toward the Sun passes close by the caster's own points.
        if (along > 0 && off < 2000) {
          ++shaded;
          ASSERT_GE(answer, 1 + static_cast<double>(k));
        }
      }
    }
    EXPECT_GT(shaded, 100U);
  }
}

// Beside a camera on the ground receivers are small and sharp: far ones don't make casters beside them matter as much.
TEST(LightTree, ASharpReceiverIsNoLargerThanItIs) {
  const Vec3 sun = sun_over(10, 30, 90, 20);
  LightTree receivers(point(sun), to_cartesian({10, 30, 0}));
  receivers.add_receiver(bounds_of(block(17, 10, 30), 0, 1), 1000);
  receivers.add_receiver(bounds_of(block(8, 10, 29.5), 0, 1), 1);
  receivers.finish();
  // Up-sun of the first, by about 5 m, and 90 m to the north of that, where light passes over the second only.
  EXPECT_EQ(receivers.shaded_pixels_per_metre(bounds_of(block(17, 10, 30.0002), 0, 4)), 1000);
  EXPECT_LE(receivers.shaded_pixels_per_metre(bounds_of(block(17, 10.003, 30.0002), 0, 4)), 1);
}

// A top that is too low to reach the disc's middle hides its lower rim.
TEST(LightTree, SolarDiscIsShadowedByLowerOccluders) {
  const Vec3 toward = sun_over(10, 30, 90, 2);
  const Vec3 top = to_cartesian({10, 30, 800});
  const double along = top.dot(toward), root = along * along - (top.squared_norm() - kMoonRadius_m * kMoonRadius_m);
  const Geographic tip = to_geographic(top - toward * (along - std::sqrt(root)));
  const double away_m = along - std::sqrt(root);
  const auto shaded = [&](double radius_deg, double below_m) {
    Sun sun = point(toward);
    sun.angular_radius_deg = radius_deg;
    LightTree receivers(sun, top);
    receivers.add_receiver(bounds_of(block(14, tip.lat_deg, tip.lon_deg), -1, 1), 0.25);
    receivers.finish();
    return receivers.shaded_pixels_per_metre(bounds_of(block(14, 10, 30), 0, 800 - below_m)) > 0;
  };
  const double rim_m = away_m * std::tan(0.2666 * kRadiansPerDegree);
  ASSERT_GT(rim_m, 50);
  EXPECT_TRUE(shaded(0.2666, 0.9 * rim_m));
  EXPECT_FALSE(shaded(0, 0.9 * rim_m));
  EXPECT_FALSE(shaded(0.2666, 2 * rim_m));
}

}  // namespace
}  // namespace selenograph::engine
