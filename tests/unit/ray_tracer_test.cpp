// One ray at a time against a sphere of triangles: which one it meets, and whether the Sun is in sight.
#include "engine/visibility/embree/ray_tracer.h"

#include <gtest/gtest.h>

#include "tests/support/sphere_mesh.h"

namespace selenograph::engine {
namespace {

class RayTracerTest : public test::SphereMesh {
 protected:
  RayTracerTest() : anchor_(place_on({0, 20, 30, false}, 0, 0)), tracer_(mesh(), anchor_, 1) {}

  // Lane i starts at height_m(i) above the middle of its triangle.
  template <typename Height>
  RayPacket over_triangles(const Height& height_m, const Vec3& direction) const {
    RayPacket rays{};
    for (int i = 0; i < kPacket; ++i) {
      const Vec3 middle = place_on(triangle(i), 1.0 / 3, 1.0 / 3);
      const Vec3 from = middle + height_m(i) * middle.normalized() - anchor_;
      rays.ox[i] = static_cast<float>(from.x());
      rays.oy[i] = static_cast<float>(from.y());
      rays.oz[i] = static_cast<float>(from.z());
      rays.dx[i] = static_cast<float>(direction.x());
      rays.dy[i] = static_cast<float>(direction.y());
      rays.dz[i] = static_cast<float>(direction.z());
      rays.active[i] = i % 5 == 4 ? 0 : -1;
    }
    return rays;
  }
  static TriangleId triangle(int i) { return {0, 20 + i / 4, 30 + i % 4, i % 2 == 1}; }
  Vec3 up() const { return anchor_.normalized(); }

  Vec3 anchor_;
  RayTracer tracer_;
};

TEST_F(RayTracerTest, ARayDownMeetsTheTriangleBelow) {
  SurfacePoints points{};
  tracer_.intersect(over_triangles([](int) { return 3000.0; }, -up()), points);
  for (int i = 0; i < kPacket; ++i) {
    ASSERT_EQ(points.hit[i], i % 5 != 4) << "active lanes alone: " << i;
    if (points.hit[i]) {
      EXPECT_EQ(points.triangle[i].packed(), triangle(i).packed()) << i;
    }
  }
}

TEST_F(RayTracerTest, ARayUpMeetsNothing) {
  SurfacePoints points{};
  tracer_.intersect(over_triangles([](int) { return 10.0; }, up()), points);
  for (int i = 0; i < kPacket; ++i) EXPECT_FALSE(points.hit[i]) << i;
}

// On a sphere the Sun is in sight above the horizon; through the ground it isn't.
TEST_F(RayTracerTest, TheSunIsInSightUnlessTheGroundIsBetween) {
  const auto heights = [](int i) { return i % 2 == 0 ? 0.0 : 500.0; };
  bool blocked[kPacket];
  tracer_.occluded(over_triangles(heights, up()), up(), 1, blocked);
  for (int i = 0; i < kPacket; ++i)
    if (i % 5 != 4) {
      EXPECT_FALSE(blocked[i]) << i;
    }
  tracer_.occluded(over_triangles([](int) { return 500.0; }, -up()), -up(), 1, blocked);
  for (int i = 0; i < kPacket; ++i)
    if (i % 5 != 4) {
      EXPECT_TRUE(blocked[i]) << i;
    }
}

}  // namespace
}  // namespace selenograph::engine
