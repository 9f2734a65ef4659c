// Which balls a ray may meet: conservative against brute force, and not useless.
#include "engine/visibility/objects/ball_images.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <random>

namespace selenograph::engine {
namespace {

class BallImagesTest : public ::testing::Test {
 protected:
  double any(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  Vec3 any_direction() {
    Vec3 v;
    do v = {any(-1, 1), any(-1, 1), any(-1, 1)};
    while (v.norm() > 1 || v.norm() < 0.1);
    return v.normalized();
  }
  // Within so many metres of kPlace.
  std::vector<Ball> balls(int count, double wide_m, double largest_m) {
    std::vector<Ball> all;
    for (int i = 0; i < count; ++i)
      all.push_back(
          {kPlace + Vec3(any(-wide_m, wide_m), any(-wide_m, wide_m), any(-wide_m, wide_m)), largest_m * any(0.05, 1)});
    return all;
  }
  Vec3 near(const Ball& ball) { return ball.centre_m + 1.5 * ball.radius_m * Vec3(any(-1, 1), any(-1, 1), any(-1, 1)); }
  static bool meets(const Vec3& origin, const Vec3& direction, const Ball& ball) {
    const Vec3 to = ball.centre_m - origin;
    const double along = to.dot(direction.normalized());
    return along > 0 && (to - along * direction.normalized()).norm() < ball.radius_m;
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
    if (meets) EXPECT_TRUE(told);
    meeting += meets, missing += !meets, missing_but_told += !meets && told;
  }
};

TEST_F(BallImagesTest, ParallelRays) {
  for (const int count : {1, 30, 2000}) {
    const Vec3 toward = any_direction();
    const std::vector<Ball> all = balls(count, 150, 10 / std::sqrt(count));
    const BallImages images = BallImages::along(toward, kPlace, all);
    Seen seen;
    for (int packet = 0; packet < 300; ++packet) {
      Lanes lanes;
      Vec3 from[kPacket];
      for (int i = 0; i < kPacket; ++i) {
        const Vec3 beside(any(-200, 200), any(-200, 200), any(-200, 200));
        from[i] = kPlace + beside - 1000 * toward;
        if (i % 2) from[i] = near(all[static_cast<std::size_t>(packet * kPacket + i) % all.size()]) - 500 * toward;
        lanes.set(i, from[i]);
      }
      const std::uint32_t told = images.may_meet(lanes.x, lanes.y, lanes.z, kAllLanes);
      for (int i = 0; i < kPacket; ++i) {
        bool any_met = false;
        for (const Ball& ball : all) any_met |= meets(from[i], toward, ball);
        seen.look(any_met, told >> i & 1);
      }
    }
    EXPECT_GT(seen.meeting, 100);
    EXPECT_LT(seen.missing_but_told, 0.45 * seen.missing) << count;  // half of the rays are next to a ball
  }
}

TEST_F(BallImagesTest, RaysFromOnePlace) {
  for (const int count : {1, 30, 2000}) {
    // Balls are around the camera, beside it and behind it, too.
    const Eigen::Matrix3d axes = Eigen::Quaterniond::FromTwoVectors(Vec3::UnitZ(), any_direction()).toRotationMatrix();
    std::vector<Ball> all = balls(count, 150, 10 / std::sqrt(count));
    if (count == 1) all[0].centre_m = kPlace + axes * Vec3(5, 3, 60);
    const BallImages images = BallImages::from(kPlace, axes, 0.7, all);
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
      const std::uint32_t told = images.may_meet(lanes.x, lanes.y, lanes.z, kAllLanes);
      for (int i = 0; i < kPacket; ++i) {
        bool any_met = false;
        for (const Ball& ball : all) any_met |= meets(kPlace, rays[i], ball);
        if (i == 6 && !any_met) continue;
        seen.look(any_met, told >> i & 1);
      }
    }
    EXPECT_GT(seen.meeting, 100);
    EXPECT_LT(seen.missing_but_told, 0.45 * seen.missing) << count;  // half of the rays are next to a ball
  }
}

TEST_F(BallImagesTest, APlaceWithinABallMeetsItAlways) {
  const Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  const std::vector<Ball> all{{kPlace, 1}, {kPlace + Vec3(0, 0, 100), 0.1}};
  const BallImages images = BallImages::from(kPlace, axes, 0.7, all);
  Lanes lanes;
  for (int i = 0; i < kPacket; ++i) lanes.set(i, Vec3(any(-0.7, 0.7), any(-0.7, 0.7), 1));
  EXPECT_EQ(images.may_meet(lanes.x, lanes.y, lanes.z, kAllLanes), kAllLanes);
}

TEST_F(BallImagesTest, LanesThatDontAskAndThoseWithoutNumbers) {
  const std::vector<Ball> all{{kPlace + Vec3(0, 0, 100), 1}};
  const BallImages images = BallImages::from(kPlace, Eigen::Matrix3d::Identity(), 0.7, all);
  Lanes lanes;
  for (int i = 0; i < kPacket; ++i) lanes.set(i, Vec3(0, 0, 1));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  lanes.set(3, Vec3(nan, nan, nan));
  EXPECT_EQ(images.may_meet(lanes.x, lanes.y, lanes.z, 0x00f0U), 0x00f0U);
  EXPECT_EQ(images.may_meet(lanes.x, lanes.y, lanes.z, 0x0008U), 0U);
  const std::vector<Ball> behind{{kPlace - Vec3(0, 0, 100), 1}};
  const BallImages none = BallImages::from(kPlace, Eigen::Matrix3d::Identity(), 0.7, behind);
  EXPECT_EQ(none.may_meet(lanes.x, lanes.y, lanes.z, kAllLanes), 0U);
}

}  // namespace
}  // namespace selenograph::engine
