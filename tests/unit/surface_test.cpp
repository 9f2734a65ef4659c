// Plane triangles seen from the centre: closed forms.
#include "dem/grid/surface.h"

#include <gtest/gtest.h>

#include <random>

namespace selenograph::dem {
namespace {

TEST(Surface, DistanceToAPlaneByHand) {
  // The plane x + y + z = 3 has distance sqrt(3) along the diagonal and 3 along an axis.
  const Triangle t{{3, 0, 0}, {0, 3, 0}, {0, 0, 3}};
  EXPECT_NEAR(*radial_distance(t, Vec3(1, 1, 1).normalized(), 0), std::sqrt(3.0), 1e-15);
  EXPECT_NEAR(*radial_distance(t, Vec3::unit_x(), 1e-12), 3, 1e-15);
  EXPECT_FALSE(radial_distance(t, Vec3(1, 1, -0.01).normalized(), 0));
  EXPECT_FALSE(radial_distance(t, -Vec3(1, 1, 1).normalized(), 0)) << "behind the centre";
  EXPECT_FALSE(radial_distance({t.a, t.c, t.b}, Vec3(1, 1, 1).normalized(), 0)) << "seen from inside out";
  EXPECT_FALSE(radial_distance({t.a, t.a, t.b}, Vec3(1, 0, 0), 0)) << "degenerate";
}

TEST(Surface, SlackIsAFractionOfTheTriangle) {
  const Triangle t{{1000, 0, 0}, {1000, 1, 0}, {1000, 0, 1}};
  EXPECT_FALSE(radial_distance(t, Vec3(1000, -0.001, 0.3).normalized(), 0));
  EXPECT_TRUE(radial_distance(t, Vec3(1000, -0.001, 0.3).normalized(), 0.0011));
  EXPECT_FALSE(radial_distance(t, Vec3(1000, -0.001, 0.3).normalized(), 0.0009));
}

TEST(Surface, EveryDirectionOverAQuadMeetsOneOfItsTriangles) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(0, 1), height(-3000, 3000);
  for (int i = 0; i < 2000; ++i) {
    Vec3 corner[2][2];
    for (int r = 0; r < 2; ++r)
      for (int c = 0; c < 2; ++c) corner[r][c] = to_cartesian({40 + r / 64.0, 10 + c / 64.0, height(random)});
    const auto triangle = [&](bool upper) {
      const QuadVertices q = vertices_of(0, 0, upper);
      return Triangle{corner[q.r[0]][q.c[0]], corner[q.r[1]][q.c[1]], corner[q.r[2]][q.c[2]]};
    };
    // A place inside, from random weights of three corners: the triangle that it was made from answers its distance.
    const bool upper = i % 2;
    const Triangle t = triangle(upper);
    double v = any(random), w = any(random);
    if (v + w > 1) v = 1 - v, w = 1 - w;
    const Vec3 p = t.a + v * (t.b - t.a) + w * (t.c - t.a);
    const auto distance = radial_distance(t, p.normalized(), 1e-12);
    ASSERT_TRUE(distance);
    EXPECT_NEAR(*distance, p.norm(), 1e-8);
    const double edge = std::min({v, w, 1 - v - w});
    if (edge > 1e-9) {
      EXPECT_FALSE(radial_distance(triangle(!upper), p.normalized(), 0));
    }
  }
}

TEST(Surface, TheDiagonalRunsFromSouthEastToNorthWest) {
  const QuadVertices lower = vertices_of(3, 5, false), upper = vertices_of(3, 5, true);
  EXPECT_EQ(lower.r[0], 3);
  EXPECT_EQ(lower.c[0], 5);  // south-west
  EXPECT_EQ(upper.r[0], 4);
  EXPECT_EQ(upper.c[0], 6);  // north-east
  EXPECT_EQ(lower.r[1], upper.r[2]);
  EXPECT_EQ(lower.c[1], upper.c[2]);
  EXPECT_EQ(lower.r[2], upper.r[1]);
  EXPECT_EQ(lower.c[2], upper.c[1]);
}

}  // namespace
}  // namespace selenograph::dem
