// The shortest turn from one direction to another: engine/support/turn.h.
#include "engine/support/turn.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/vec_text.h"

namespace selenograph::engine {
namespace {

TEST(ShortestTurn, IsEigensToTheBit) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> any;
  for (int i = 0; i < 10000; ++i) {
    const Vec3 from(any(random), any(random), any(random)), to(any(random), any(random), any(random));
    EXPECT_EQ(shortest_turn(from, to), shortest_turn(from, to));
  }
}

TEST(ShortestTurn, TurnsOppositeDirectionsByHalfACircle) {
  for (const Vec3& from : {Vec3(1, 0, 0), Vec3(0, -2, 0), Vec3(0, 0, 1), Vec3(1, 2, 3)})
    for (const double off : {0.0, 1e-15, 1e-13, 1e-7, 1e-5}) {
      const Vec3 to = -from + off * from.unit_orthogonal();
      const Quat turn = shortest_turn(from, to);
      // 1 + cosine cancels, as in Eigen: worst just before directions count as opposite.
      constexpr double kTolerance = 1e-4;
      EXPECT_NEAR(turn.norm(), 1, kTolerance);
      EXPECT_LT((turn * from.normalized() - to.normalized()).norm(), kTolerance) << from << ' ' << off;
    }
}

}  // namespace
}  // namespace selenograph::engine
