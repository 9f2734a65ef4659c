// Which ellipsoids a ray may meet: conservative against brute force, and not useless.
#include "engine/visibility/objects/ellipsoid_images.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "dem/grid/rotation.h"

namespace selenograph::engine {
namespace {

class EllipsoidImagesTest : public ::testing::Test {
 protected:
  double any(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  Vec3 any_direction() {
    Vec3 v;
    do v = {any(-1, 1), any(-1, 1), any(-1, 1)};
    while (v.norm() > 1 || v.norm() < 0.1);
    return v.normalized();
  }
  static Ellipsoid ball(const Vec3& centre_m, double radius_m) { return {centre_m, radius_m * Mat3::identity()}; }
  // Within so many metres of kPlace; up to five times as long as they are wide.
  std::vector<Ellipsoid> ellipsoids(int count, double wide_m, double largest_m) {
    std::vector<Ellipsoid> all;
    for (int i = 0; i < count; ++i) {
      const Mat3 turned = shortest_turn(any_direction(), any_direction()).matrix();
      const Vec3 lengths(any(0.2, 1), any(0.2, 1), any(0.2, 1));
      all.push_back({kPlace + Vec3(any(-wide_m, wide_m), any(-wide_m, wide_m), any(-wide_m, wide_m)),
                     largest_m * any(0.05, 1) * (turned * Mat3::diagonal(lengths))});
    }
    return all;
  }
  Vec3 near(const Ellipsoid& e) { return e.centre_m + 1.5 * (e.axes_m * Vec3(any(-1, 1), any(-1, 1), any(-1, 1))); }
  // In coordinates in which it is the unit ball.
  static bool meets(const Vec3& origin, const Vec3& direction, const Ellipsoid& e) {
    const Mat3 to_ball = e.axes_m.inverse();
    const Vec3 from = to_ball * (origin - e.centre_m), along = to_ball * direction;
    const double a = along.squared_norm(), b = from.dot(along), root2 = b * b - a * (from.squared_norm() - 1);
    return root2 > 0 && -b + std::sqrt(root2) > 0;
  }

  const Vec3 kPlace{1.1e6, -0.9e6, 0.95e6};
  std::mt19937 random_{7};
};

struct Lanes {
  double x[kPacket], y[kPacket], z[kPacket];
  void set(int i, const Vec3& v) { x[i] = v.x(), y[i] = v.y(), z[i] = v.z(); }
};

struct Seen {
  int meeting = 0, missing = 0, missing_but_told = 0;
  void look(bool meets, bool told) {
    if (meets) {
      EXPECT_TRUE(told);
    }
    meeting += meets, missing += !meets, missing_but_told += !meets && told;
  }
};

TEST_F(EllipsoidImagesTest, ParallelRays) {
  for (const int count : {1, 30, 2000}) {
    const Vec3 toward = any_direction();
    const std::vector<Ellipsoid> all = ellipsoids(count, 150, 10 / std::sqrt(count));
    const EllipsoidImages images = EllipsoidImages::along(toward, kPlace, all);
    Seen seen;
    for (int packet = 0; packet < 300; ++packet) {
      Lanes lanes;
      Vec3 from[kPacket];
      for (int i = 0; i < kPacket; ++i) {
        const Vec3 beside(any(-200, 200), any(-200, 200), any(-200, 200));
        from[i] = kPlace + beside - 1000 * toward;
        if (i % 2)
          from[i] = near(all[static_cast<std::size_t>(packet * kPacket + i) % all.size()]) - any(-1, 5) * toward;
        lanes.set(i, from[i]);
      }
      const std::uint32_t told = images.may_hit(lanes.x, lanes.y, lanes.z, kAllLanes);
      for (int i = 0; i < kPacket; ++i) {
        bool any_met = false;
        for (const Ellipsoid& e : all) any_met |= meets(from[i], toward, e);
        seen.look(any_met, told >> i & 1);
      }
    }
    EXPECT_GT(seen.meeting, 100);
    EXPECT_LT(seen.missing_but_told, 0.45 * seen.missing) << count;  // half of the rays are next to one
  }
}

// As of ground on the sunward side of a rock.
TEST_F(EllipsoidImagesTest, RaysFromBeyondMeetNothing) {
  const Vec3 toward = any_direction();
  const std::vector<Ellipsoid> all = ellipsoids(200, 150, 1);
  const EllipsoidImages images = EllipsoidImages::along(toward, kPlace, all);
  int before = 0, beyond = 0;
  for (const Ellipsoid& e : all) {
    Lanes lanes;
    const double reach_m = (e.axes_m.transpose() * toward).norm();
    for (int i = 0; i < kPacket; ++i) lanes.set(i, e.centre_m + (i % 2 ? 1.1 : -1.1) * reach_m * toward);
    const std::uint32_t told = images.may_hit(lanes.x, lanes.y, lanes.z, kAllLanes);
    before += (told & 1) != 0, beyond += (told & 2) != 0;
  }
  EXPECT_EQ(before, 200);
  EXPECT_LT(beyond, 30);  // others of the same cells
}

TEST_F(EllipsoidImagesTest, RaysFromOnePlace) {
  for (const int count : {1, 30, 2000}) {
    // They are around the camera, beside it and behind it, too; every second one, or the only one, is in front.
    const Mat3 axes = shortest_turn(Vec3::unit_z(), any_direction()).matrix();
    std::vector<Ellipsoid> all = ellipsoids(count, 150, 10 / std::sqrt(count));
    for (std::size_t i = count == 1 ? 0 : 1; i < all.size(); i += 2)
      all[i].centre_m = kPlace + axes * (any(20, 150) * Vec3(any(-0.3, 0.3), any(-0.3, 0.3), 1));
    const EllipsoidImages images = EllipsoidImages::from(kPlace, axes, 0.7, all);
    Seen seen;
    for (int packet = 0; packet < 600; ++packet) {
      Lanes lanes;
      Vec3 rays[kPacket];
      for (int i = 0; i < kPacket; ++i) {
        rays[i] = axes * Vec3(any(-0.7, 0.7), any(-0.7, 0.7), 1);
        const Vec3 to = near(all[static_cast<std::size_t>(packet * kPacket + i) % all.size()]) - kPlace;
        if (i % 2 && axes.col(2).dot(to) > 0.9 * to.norm()) rays[i] = to;
        if (i == 6) rays[i] = axes * Vec3(any(-9, 9), any(-9, 9), 1);  // beyond the cells
        lanes.set(i, rays[i]);
      }
      const std::uint32_t told = images.may_hit(lanes.x, lanes.y, lanes.z, kAllLanes);
      for (int i = 0; i < kPacket; ++i) {
        bool any_met = false;
        for (const Ellipsoid& e : all) any_met |= meets(kPlace, rays[i], e);
        if (i == 6 && !any_met) continue;
        seen.look(any_met, told >> i & 1);
      }
    }
    EXPECT_GT(seen.meeting, 100);
    EXPECT_LT(seen.missing_but_told, 0.45 * seen.missing) << count;  // half of the rays are next to one
  }
}

TEST_F(EllipsoidImagesTest, APlaceWithinAnEllipsoidMeetsItAlways) {
  const Mat3 axes = Mat3::identity();
  const std::vector<Ellipsoid> all{ball(kPlace, 1), ball(kPlace + Vec3(0, 0, 100), 0.1)};
  const EllipsoidImages images = EllipsoidImages::from(kPlace, axes, 0.7, all);
  Lanes lanes;
  for (int i = 0; i < kPacket; ++i) lanes.set(i, Vec3(any(-0.7, 0.7), any(-0.7, 0.7), 1));
  EXPECT_EQ(images.may_hit(lanes.x, lanes.y, lanes.z, kAllLanes), kAllLanes);
}

TEST_F(EllipsoidImagesTest, LanesThatDontAskAndThoseWithoutNumbers) {
  const std::vector<Ellipsoid> all{ball(kPlace + Vec3(0, 0, 100), 1)};
  const EllipsoidImages images = EllipsoidImages::from(kPlace, Mat3::identity(), 0.7, all);
  Lanes lanes;
  for (int i = 0; i < kPacket; ++i) lanes.set(i, Vec3(0, 0, 1));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  lanes.set(3, Vec3(nan, nan, nan));
  EXPECT_EQ(images.may_hit(lanes.x, lanes.y, lanes.z, 0x00f0U), 0x00f0U);
  EXPECT_EQ(images.may_hit(lanes.x, lanes.y, lanes.z, 0x0008U), 0U);
  const std::vector<Ellipsoid> behind{ball(kPlace - Vec3(0, 0, 100), 1)};
  const EllipsoidImages none = EllipsoidImages::from(kPlace, Mat3::identity(), 0.7, behind);
  EXPECT_EQ(none.may_hit(lanes.x, lanes.y, lanes.z, kAllLanes), 0U);
}

}  // namespace
}  // namespace selenograph::engine
