// One cliff and its shadow, whose end is a straight line through the cliff's upper edge.
#include "engine/visibility/zbuffer/shadow_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <vector>

#include "engine/scene/raster_mesh.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

constexpr double kPostsPerDegree = 4, kEdge_deg = 1 / kPostsPerDegree, kCliff_m = 5000;

// All blocks within 10 degrees of 0 N 0 E whose posts are the file's.
std::vector<dem::BlockId> around_the_cliff() {
  int level = 0;
  while (dem::post_spacing_m(level) > 1.01 * kMetresPerDegree / kPostsPerDegree) ++level;
  std::vector<dem::BlockId> blocks;
  for (int row = 0; row < dem::rows_of(level); ++row)
    for (int col = 0; col < dem::columns_of(level, row); ++col) {
      const dem::BlockExtent e = dem::extent_of({level, row, col});
      const Vec3 middle = to_cartesian(
          {dem::lat_deg_of(e.lat0 + e.quads / 2 * e.lat_step), dem::lon_deg_of(e.lon0 + e.quads / 2 * e.lon_step), 0});
      if (middle.normalized().x() > std::cos(10 * kRadiansPerDegree)) blocks.push_back({level, row, col});
    }
  std::sort(blocks.begin(), blocks.end());
  return blocks;
}

class ShadowMapTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder;
    test::write_global_tile(folder_->path(), kPostsPerDegree,
                            [](double lat_deg, double) { return lat_deg > kEdge_deg / 2 ? kCliff_m : 0; });
    terrain_ = test::open_terrain(folder_->path());
    mesh_ = std::make_unique<Mesh>(*terrain_, around_the_cliff());
    raster_ = std::make_unique<RasterMesh>(*mesh_, kMoonRadius_m * Vec3::UnitX());
  }
  static void TearDownTestSuite() {
    raster_.reset(), mesh_.reset(), terrain_.reset();
    delete folder_;
  }
  static const RasterMesh& mesh() { return *raster_; }

  // From the north, so high above 0 N 0 E's horizon.
  static Vec3 sun(double elevation_deg) {
    const double e = elevation_deg * kRadiansPerDegree;
    return {std::sin(e), 0, std::cos(e)};
  }

  // Of sixteen points, those in shadow.
  static std::set<std::uint32_t> shadowed(const ShadowMap& map, const SurfacePoints& points) {
    LightLanes lanes;
    map.place(points, lanes);
    std::vector<LightSamples> samples(1);
    samples[0].clear(kPacket);
    samples[0].add_all(lanes, 0);
    samples[0].bound();
    LightScratch scratch;
    map.cast(samples, scratch, {});
    std::set<std::uint32_t> pixels;
    for (const auto& band : scratch.shadowed) pixels.insert(band.begin(), band.end());
    return pixels;
  }

  static inline test::TemporaryFolder* folder_ = nullptr;
  static inline std::shared_ptr<dem::Terrain> terrain_;
  static inline std::unique_ptr<Mesh> mesh_;
  static inline std::unique_ptr<RasterMesh> raster_;
};

// Points down the Sun's ray from the cliff's edge, in turn a little below and above it.
SurfacePoints beside_the_ray(const Vec3& sun) {
  const Vec3 edge = to_cartesian({kEdge_deg, 0.002, kCliff_m});  // 60 m from a post
  SurfacePoints p{};
  for (int i = 0; i < kPacket; ++i) {
    const Vec3 at = edge - (1000 + 1000 * i) * sun + (i % 2 ? 1 : -1) * Vec3::UnitX();
    p.hit[i] = true, p.x[i] = at.x(), p.y[i] = at.y(), p.z[i] = at.z();
  }
  return p;
}

TEST_F(ShadowMapTest, EndsOnTheRayThroughTheCliffsEdge) {
  for (const double elevation : {3.0, 10.0, 15.0}) {
    const ShadowMap map(mesh(), sun(elevation));
    const auto dark = shadowed(map, beside_the_ray(sun(elevation)));
    for (std::uint32_t i = 0; i < kPacket; ++i)
      EXPECT_EQ(dark.contains(i), i % 2 == 0) << elevation << " degrees, " << 1 + i << " km from the edge";
  }
}

TEST_F(ShadowMapTest, AHighSunOrOneFromBehindLeavesNone) {
  const SurfacePoints points = beside_the_ray(sun(10));
  EXPECT_TRUE(shadowed(ShadowMap(mesh(), sun(60)), points).empty());
  EXPECT_TRUE(shadowed(ShadowMap(mesh(), sun(170)), points).empty());
}

TEST_F(ShadowMapTest, SamplesTurnFromOneMapToAnother) {
  const ShadowMap from(mesh(), sun(10)), to(mesh(), sun(10.3));
  const SurfacePoints points = beside_the_ray(sun(10));
  LightLanes placed, expected;
  from.place(points, placed), to.place(points, expected);
  LightSamples samples, turned;
  samples.clear(kPacket, true);
  std::int32_t faces[kPacket];
  for (int i = 0; i < kPacket; ++i) faces[i] = i < 10 ? 1 : 2;
  samples.add_faces(faces);
  samples.add_all(placed, 100);
  to.turn(from, samples, 1, turned);
  ASSERT_EQ(turned.count, 10U) << "those that face the direction of the mask";
  for (std::size_t i = 0; i < 10; ++i) {
    EXPECT_NEAR(turned.u[i], expected.u[i], 0.02) << "float at 30 km";
    EXPECT_NEAR(turned.v[i], expected.v[i], 0.02);
    EXPECT_NEAR(turned.d[i], expected.d[i], 0.02);
    EXPECT_EQ(turned.pixel[i], 100 + i);
  }
}

}  // namespace
}  // namespace selenograph::engine
