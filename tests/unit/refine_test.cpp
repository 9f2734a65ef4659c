// One ray, one triangle: where they meet follows from the weights that the place was made of.
#include "engine/visibility/points/refine.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "tests/support/sphere_mesh.h"

namespace selenograph::engine {
namespace {

constexpr int kLane = 5;

class Refine : public test::SphereMesh {
 protected:
  struct Met {
    SurfacePoints points;
    Facets facets;
    bool hit() const { return points.hit[kLane]; }
    TriangleId triangle() const { return points.triangle[kLane]; }
  };
  // A ray from `origin`, which float took to meet `guess`.
  static Met met(const Vec3& origin, const Vec3& direction, const TriangleId& guess) {
    Met met{};
    Rays rays{};
    for (int i = 0; i < kPacket; ++i) rays.set(i, origin, direction), met.points.triangle[i] = guess;
    for (int i = 0; i < kPacket; ++i) rays.valid[i] = met.points.hit[i] = i == kLane;
    refine(mesh(), rays, met.points, met.facets);
    return met;
  }
  static inline const TriangleId kTriangle{0, 20, 30, false};
};

TEST_F(Refine, APlaceOnATriangleIsMetThere) {
  const Vec3 place = place_on(kTriangle, 0.25, 0.5), origin = 1.02 * place + Vec3(3000, -2000, 1000);
  const Met m = met(origin, (place - origin) / 4, kTriangle);
  ASSERT_TRUE(m.hit());
  EXPECT_EQ(m.triangle().packed(), kTriangle.packed());
  EXPECT_LT((m.points.position(kLane) - place).norm(), 1e-8);
  EXPECT_NEAR(m.points.distance[kLane], 4, 1e-12) << "in lengths of the direction";
  EXPECT_NEAR(m.points.v[kLane], 0.25, 1e-9);
  EXPECT_NEAR(m.points.w[kLane], 0.5, 1e-9);
}

TEST_F(Refine, TheNormalIsOutwardAndTwiceTheAreaLong) {
  const Vec3 place = place_on(kTriangle, 0.3, 0.3);
  const Met m = met(1.01 * place, -place, kTriangle);
  ASSERT_TRUE(m.hit());
  const dem::Triangle t = mesh().triangle(kTriangle);
  const Vec3 normal(m.points.nx[kLane], m.points.ny[kLane], m.points.nz[kLane]),
      expected = (t.b - t.a).cross(t.c - t.a);
  EXPECT_LT((normal - expected).norm(), 1e-12 * expected.norm());
  EXPECT_GT(normal.dot(place), 0);
}

TEST_F(Refine, OnTheWrongSideOfAnEdgeTheNeighbourIsTaken) {
  const Vec3 place = place_on(kTriangle, 0.25, 0.5);
  const Met m = met(1.01 * place, -place, kTriangle.other_half());
  ASSERT_TRUE(m.hit());
  EXPECT_EQ(m.triangle().packed(), kTriangle.packed());
  EXPECT_LT((m.points.position(kLane) - place).norm(), 1e-8);
}

TEST_F(Refine, TheMiddleOfAnEdgeIsMetFromEitherSide) {
  const dem::Triangle t = mesh().triangle(kTriangle), other = mesh().triangle(kTriangle.other_half());
  // The diagonal: the two vertices that both halves have.
  Vec3 place = Vec3::Zero();
  int common = 0;
  for (const Vec3& p : {t.a, t.b, t.c})
    for (const Vec3& q : {other.a, other.b, other.c})
      if (p == q) place += p / 2, ++common;
  ASSERT_EQ(common, 2);
  for (const TriangleId& guess : {kTriangle, kTriangle.other_half()}) {
    const Met m = met(1.01 * place, -place, guess);
    ASSERT_TRUE(m.hit());
    EXPECT_LT((m.points.position(kLane) - place).norm(), 1e-8);
  }
}

TEST_F(Refine, NoHitFromBelow) {
  const Vec3 place = place_on(kTriangle, 0.25, 0.5);
  EXPECT_FALSE(met(0.99 * place, place, kTriangle).hit());
}

TEST_F(Refine, BuriedIsWhatLiesBelowTheTriangle) {
  const Vec3 place = place_on(kTriangle, 0.25, 0.5), up = place.normalized();
  EXPECT_TRUE(buried(mesh(), kTriangle, place - up));
  EXPECT_FALSE(buried(mesh(), kTriangle, place + up));
}

TEST_F(Refine, FacetsAreTheMeshsTriangles) {
  ASSERT_GT(mesh().blocks().size(), 1U);
  for (const std::uint32_t other_block : {0U, 1U}) {
    TriangleId ids[kPacket];
    for (int i = 0; i < kPacket; ++i) ids[i] = TriangleId(i % 3 == 0 ? other_block : 0, 7 * i % 63, 11 * i % 61, i % 2);
    EXPECT_EQ(in_one_block(ids), other_block == 0);
    Facets facets;
    gather(mesh(), ids, facets);
    for (int i = 0; i < kPacket; ++i) {
      const dem::Triangle t = mesh().triangle(ids[i]);
      for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(facets.a[k][i], t.a[k]);
        EXPECT_EQ(facets.b[k][i], t.b[k]);
        EXPECT_EQ(facets.c[k][i], t.c[k]);
      }
    }
  }
}

}  // namespace
}  // namespace selenograph::engine
