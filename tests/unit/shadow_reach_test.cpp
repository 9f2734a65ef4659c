// Boxes in light space, and samples above and below them.
#include "engine/visibility/zbuffer/shadow_reach.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "engine/support/packet.h"

namespace selenograph::engine {
namespace {

constexpr int kColumns = 40, kRows = 24;
constexpr float kPer_u = 0.5F, kPer_v = 0.25F, kU0 = -30, kV0 = -50;

// One sample sixteen times.
bool reached(const ShadowReach& reach, float u, float v, float d) {
  const std::vector<float> us(kPacket, u), vs(kPacket, v), ds(kPacket, d);
  std::uint8_t out = 2;
  reach.find_reached(us.data(), vs.data(), ds.data(), 1, &out);
  return out != 0;
}

TEST(ShadowReach, NothingReachesWhereThereIsNoCaster) {
  const ShadowReach reach(kU0, kV0, kPer_u, kPer_v, kColumns, kRows);
  EXPECT_FALSE(reached(reach, 0, 0, -1e6F));
  EXPECT_FALSE(reached(reach, -1e4F, 1e4F, -1e6F));
}

TEST(ShadowReach, SamplesBelowACasterAreReachedAndThoseAboveOrFarFromItAreNot) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> u(-40, 60), v(-60, 60), size(0, 12), d(-100, 100);
  for (int trial = 0; trial < 500; ++trial) {
    ShadowReach reach(kU0, kV0, kPer_u, kPer_v, kColumns, kRows);
    const LightBox box{u(random), 0, v(random), 0, d(random)};
    const LightBox caster{box.u_low, box.u_low + size(random), box.v_low, box.v_low + size(random), box.d_high};
    reach.add(caster);
    for (int k = 0; k < 50; ++k) {
      const float su = u(random), sv = v(random), sd = d(random);
      const bool over = su >= caster.u_low && su <= caster.u_high && sv >= caster.v_low && sv <= caster.v_high;
      const bool found = reached(reach, su, sv, sd);
      EXPECT_FALSE(sd > caster.d_high && found);
      EXPECT_FALSE(over && sd <= caster.d_high && !found);
      // Two cells away, and neither beside the cells.
      const float end = kU0 + kColumns / kPer_u;
      const bool inside = su > kU0 && su < end && caster.u_low > kU0 && caster.u_high < end;
      const bool far = su < caster.u_low - 2 / kPer_u - 1 || su > caster.u_high + 2 / kPer_u + 1;
      EXPECT_FALSE(inside && far && found);
    }
  }
}

TEST(ShadowReach, OneOfSixteenIsEnough) {
  ShadowReach reach(kU0, kV0, kPer_u, kPer_v, kColumns, kRows);
  reach.add({0, 5, 0, 5, 10});
  std::vector<float> u(kPacket, 40), v(kPacket, 2), d(kPacket, 0);
  std::uint8_t out = 2;
  reach.find_reached(u.data(), v.data(), d.data(), 1, &out);
  EXPECT_EQ(out, 0);
  u[11] = 2;
  reach.find_reached(u.data(), v.data(), d.data(), 1, &out);
  EXPECT_EQ(out, 1);
}

}  // namespace
}  // namespace selenograph::engine
