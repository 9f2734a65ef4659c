// One ray, one triangle: where they meet follows from the weights that the place was made of.
#include "engine/visibility/points/refine.h"

#include <gtest/gtest.h>

#include <random>
#include <utility>

#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"
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
  Vec3 place = Vec3::zero();
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

// Walls of up to 89 degrees in all directions: some triangles contain the axis that weights are measured along.
TEST(RefineWalls, WeightsAreThoseOfThePlaceWhereverItIsAndHoweverSteep) {
  for (const auto& [north_deg, west_deg] : {std::pair{0.5, -0.5}, {45.5, 44.5}, {-60.0, 134.0}, {20.0, -100.0}}) {
    const test::TemporaryFolder folder;
    std::mt19937 random(7);
    std::uniform_real_distribution<double> share(0, 1);
    test::write_float_tile(folder.path(), "walls", {north_deg, west_deg, 256, 257, 257},
                           [&](double, double) { return 9000 * share(random); });
    const auto terrain = test::open_terrain(folder.path());
    const auto tick = [](double from_deg, double deg) {
      return static_cast<dem::Tick>((deg + from_deg) * dem::kTicksPerDegree);
    };
    const Mesh mesh(*terrain, {dem::block_at(8, tick(90, north_deg - 0.5), tick(180, west_deg + 0.5))});
    ASSERT_FALSE(mesh.blocks().empty());
    int steep = 0;
    for (int trial = 0; trial < 20000; ++trial) {
      const int quads = mesh.blocks()[0].posts->extent.quads;
      const auto any = [&] { return static_cast<int>(share(random) * quads); };
      const TriangleId id(0, any(), any(), share(random) < 0.5);
      const dem::Triangle t = mesh.triangle(id);
      const double v = 0.01 + 0.9 * share(random), w = (0.98 - v) * share(random) + 0.01;
      const Vec3 place = (1 - v - w) * t.a + v * t.b + w * t.c, normal = (t.b - t.a).cross(t.c - t.a).normalized();
      if (normal.has_nan()) continue;
      steep += std::abs(normal[mesh.blocks()[0].axis]) < 0.02;
      const Vec3 direction = -normal + 0.3 * Vec3(share(random), share(random), share(random));
      Rays rays{};
      SurfacePoints points{};
      Facets facets;
      for (int i = 0; i < kPacket; ++i)
        rays.set(i, place - 500 * direction, direction), points.triangle[i] = id, points.hit[i] = true;
      refine(mesh, rays, points, facets);
      ASSERT_TRUE(points.hit[kLane]);
      ASSERT_EQ(points.triangle[kLane].packed(), id.packed());
      ASSERT_NEAR(points.v[kLane], v, 1e-8);
      ASSERT_NEAR(points.w[kLane], w, 1e-8);
      ASSERT_LT((points.position(kLane) - place).norm(), 1e-7);
    }
    EXPECT_GT(steep, 20) << "at " << north_deg << ", " << west_deg;
  }
}

}  // namespace
}  // namespace selenograph::engine
