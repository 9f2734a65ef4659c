// A row of sixteen pixels on a sphere's triangles: points, light and radiance follow from the weights of one point.
#include "engine/visibility/zbuffer/row_kernel.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <random>

#include "engine/camera/packet_rays.h"
#include "tests/support/sphere_mesh.h"
#include "tests/support/views.h"

namespace selenograph::engine {
namespace {

constexpr int kRow = 20;            // of the image
constexpr double kSunlight = 1361;  // W m-2
constexpr float kBase = 0.25F;      // W m-2 sr-1

struct Scenery {
  TriangleId triangle;
  Vec3 point;  // that pixel `lane` sees
  int lane;
  View view;
  Vec3 sun;
};

class RowKernel : public test::SphereMesh {
 protected:
  // A camera `distance_m` from a point of a triangle, whose sixteen pixels see that triangle only.
  static Scenery scenery(std::mt19937& random, double distance_m, double v, double w) {
    std::uniform_real_distribution<double> any(-1, 1);
    std::uniform_int_distribution<int> quad(8, 20), lane(0, kPacket - 1);
    Scenery s{TriangleId(0, quad(random), quad(random), any(random) > 0), {}, lane(random), View(camera(1), {}), {}};
    s.point = place_on(s.triangle, v, w);
    const Vec3 up = s.point.normalized();
    const auto direction = [&](double steepest) {
      return (up * steepest + Vec3(any(random), any(random), any(random)) * 0.5).normalized();
    };
    const Vec3 eye = s.point + distance_m * direction(1);
    const Camera pixels = camera(distance_m / 10);  // a pixel is about 10 m wide, a side of the triangle 1.9 km
    Pose pose = test::looking(eye, s.point - eye, Vec3::UnitZ());
    s.view = View(pixels, pose);
    s.sun = direction(0.8);
    return s;
  }
  static Camera camera(double focal_px) {
    Camera c;
    c.width = 640;
    c.height = 40;
    c.fx = c.fy = focal_px;
    c.cx = 300;
    c.cy = kRow;
    return c;
  }
  // Returns whether the lane of the point is resolved. `others`: the triangle of all other lanes.
  static bool resolve(const Scenery& s, const Brdf& brdf, ResolvedRow& out, std::optional<TriangleId> others = {}) {
    const std::array<Vec3, 3> axes{across(s.sun), s.sun.cross(across(s.sun)), s.sun};
    const RowTerms terms(s.view, anchor(s), axes, brdf, kSunlight, kBase);
    TriangleId ids[kPacket];
    std::fill_n(ids, kPacket, others.value_or(s.triangle));
    ids[s.lane] = s.triangle;
    resolve_row(mesh(), terms, 300 - s.lane, kRow, ids, out);
    return out.resolved >> s.lane & 1;
  }
  static Vec3 across(const Vec3& sun) { return sun.cross(Vec3::UnitZ()).normalized(); }
  static Vec3 anchor(const Scenery& s) { return s.point.normalized() * kMoonRadius_m + Vec3(300, -200, 100); }
};

TEST_F(RowKernel, FindsPlaceInLightAndRadianceOfAKnownPoint) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> weight(0.3, 0.35);
  for (const double distance_m : {20e3, 4e5, 4e8})
    for (int i = 0; i < 300; ++i) {
      const Scenery s = scenery(random, distance_m, weight(random), weight(random));
      Reflectance reflectance;
      reflectance.model = std::array{ReflectanceModel::lommel_seeliger_lambert, ReflectanceModel::moon,
                                     ReflectanceModel::hapke}[static_cast<std::size_t>(i % 3)];
      reflectance.lommel_seeliger_weight = 0.7;
      const Brdf brdf(reflectance);
      ResolvedRow row;
      ASSERT_TRUE(resolve(s, brdf, row));
      const Vec3 from_anchor = s.point - anchor(s), axis = across(s.sun);
      const double rounding_m = 1e-4 + 1e-15 * distance_m;
      EXPECT_NEAR(row.light.u[s.lane], axis.dot(from_anchor), rounding_m);
      EXPECT_NEAR(row.light.v[s.lane], s.sun.cross(axis).dot(from_anchor), rounding_m);
      EXPECT_NEAR(row.light.d[s.lane], s.sun.dot(from_anchor), rounding_m);
      // Normals of a sphere without relief are radial, to the chord of a post: 1e-3 of a radian.
      const Vec3 up = s.point.normalized(), to_camera = (s.view.position() - s.point).normalized();
      const double mu0 = up.dot(s.sun), mu = up.dot(to_camera);
      const double expected =
          kSunlight * (mu0 > 0 ? brdf.times_mu0(mu0, mu, to_camera.dot(s.sun)) : 0) + static_cast<double>(kBase);
      ASSERT_GT(std::abs(mu0), 2e-3);
      EXPECT_NEAR(row.radiance[s.lane], expected, 0.02) << "of some 30 W m-2 sr-1";
      EXPECT_EQ(row.lit >> s.lane & 1, mu0 > 0 ? 1U : 0U);
    }
}

TEST_F(RowKernel, LeavesPixelsAtEdgesAndBeyondUnresolved) {
  std::mt19937 random(11);
  const Brdf brdf{Reflectance()};
  const double inside[][2] = {{0.3, 0.3}, {0.2, 0.6}}, outside[][2] = {{5e-6, 0.3}, {0.3, -1e-3}, {0.4, 0.6 + 1e-5}};
  for (int i = 0; i < 50; ++i) {
    ResolvedRow row;
    for (const auto& [v, w] : inside) EXPECT_TRUE(resolve(scenery(random, 2e4, v, w), brdf, row)) << v << ' ' << w;
    for (const auto& [v, w] : outside) EXPECT_FALSE(resolve(scenery(random, 2e4, v, w), brdf, row)) << v << ' ' << w;
  }
}

TEST_F(RowKernel, LeavesRaysFromBelowUnresolved) {
  std::mt19937 random(13);
  Scenery s = scenery(random, 2e4, 0.3, 0.3);
  const Vec3 below = s.point * 0.98;
  s.view = View(camera(2e3), test::looking(below, s.point - below, Vec3::UnitZ()));
  ResolvedRow row;
  EXPECT_FALSE(resolve(s, Brdf(Reflectance()), row));
}

TEST_F(RowKernel, ResolvesAPixelWhateverItsNeighboursAre) {
  std::mt19937 random(19);
  const Brdf brdf{Reflectance()};
  for (int i = 0; i < 50; ++i) {
    const Scenery s = scenery(random, 2e4, 0.3, 0.3);
    ResolvedRow alone, among_others;
    ASSERT_TRUE(resolve(s, brdf, alone));
    ASSERT_TRUE(resolve(s, brdf, among_others, s.triangle.other_half()));
    EXPECT_EQ(alone.resolved, kAllLanes);
    EXPECT_EQ(among_others.resolved, 1U << s.lane) << "the neighbours' rays miss the other half";
    EXPECT_EQ(among_others.lit & ~among_others.resolved, 0U);
    EXPECT_EQ(among_others.lit >> s.lane & 1, alone.lit >> s.lane & 1);
    EXPECT_EQ(among_others.radiance[s.lane], alone.radiance[s.lane]);
    EXPECT_EQ(among_others.light.u[s.lane], alone.light.u[s.lane]);
    EXPECT_EQ(among_others.light.d[s.lane], alone.light.d[s.lane]);
  }
}

TEST_F(RowKernel, LeavesTheDarkSideOfTheMoonUnresolved) {
  // With the Sun below the horizon a slope may face it that the Moon's interior hides.
  std::mt19937 random(17);
  Scenery s = scenery(random, 2e4, 0.3, 0.3);
  s.sun = (-s.point.normalized() + 0.2 * across(s.point.normalized())).normalized();
  ResolvedRow row;
  ASSERT_TRUE(resolve(s, Brdf(Reflectance()), row)) << "no facet of the sphere faces that Sun";
  EXPECT_EQ(row.lit, 0U);
  for (const float radiance : row.radiance) EXPECT_EQ(radiance, kBase);
}

}  // namespace
}  // namespace selenograph::engine
