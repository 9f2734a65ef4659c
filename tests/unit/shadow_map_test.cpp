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

constexpr int kLevel = 8;  // whose posts are the file's: nothing is filtered
constexpr double kPostsPerDegree = 256, kEdge_deg = 1 / kPostsPerDegree, kCliff_m = 60;

// The blocks within half a degree of 0 N 0 E.
std::vector<dem::BlockId> around_the_cliff() {
  std::vector<dem::BlockId> blocks;
  for (const double lat : {-0.375, -0.125, 0.125, 0.375})
    for (const double lon : {-0.375, -0.125, 0.125, 0.375})
      blocks.push_back(dem::block_at(kLevel, static_cast<dem::Tick>((lat + 90) * dem::kTicksPerDegree),
                                     static_cast<dem::Tick>((lon + 180) * dem::kTicksPerDegree)));
  std::sort(blocks.begin(), blocks.end());
  return blocks;
}

class ShadowMapTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder;
    test::write_float_tile(folder_->path(), "cliff", {1, -1, kPostsPerDegree, 513, 513},
                           [](double lat_deg, double) { return lat_deg > kEdge_deg / 2 ? kCliff_m : 0; });
    terrain_ = test::open_terrain(folder_->path());
    mesh_ = std::make_unique<Mesh>(*terrain_, around_the_cliff());
    raster_ = std::make_unique<RasterMesh>(*mesh_, kMoonRadius_m * Vec3::unit_x());
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
    samples[0].add_packet(lanes, 0);
    samples[0].bound();
    LightScratch scratch;
    map.cast(samples, scratch, {});
    std::set<std::uint32_t> pixels;
    for (const auto& band : scratch.shadowed) pixels.insert(band.begin(), band.end());
    return pixels;
  }

  static inline test::TemporaryFolder* folder_ = nullptr;
  static inline std::shared_ptr<dem::PyramidTerrain> terrain_;
  static inline std::unique_ptr<Mesh> mesh_;
  static inline std::unique_ptr<RasterMesh> raster_;
};

// Points down the Sun's ray from the cliff's edge, in turn 5 cm below and above it.
SurfacePoints beside_the_ray(const Vec3& sun) {
  const Vec3 edge = to_cartesian({kEdge_deg, 1e-4, kCliff_m});  // 3 m from a post: the edge is a chord
  SurfacePoints p{};
  for (int i = 0; i < kPacket; ++i) {
    const Vec3 at = edge - (20 + 20 * i) * sun + (i % 2 ? 0.05 : -0.05) * Vec3::unit_x();
    p.hit[i] = true, p.x[i] = at.x(), p.y[i] = at.y(), p.z[i] = at.z();
  }
  return p;
}

TEST_F(ShadowMapTest, EndsOnTheRayThroughTheCliffsEdge) {
  for (const double elevation : {3.0, 10.0, 15.0}) {
    const ShadowMap map(mesh(), sun(elevation));
    ASSERT_GT(mesh().strips().size(), 0U);
    const auto dark = shadowed(map, beside_the_ray(sun(elevation)));
    for (std::uint32_t i = 0; i < kPacket; ++i)
      EXPECT_EQ(dark.contains(i), i % 2 == 0) << elevation << " degrees, " << 20 + 20 * i << " m from the edge";
  }
}

TEST_F(ShadowMapTest, AHighSunOrOneFromBehindLeavesNone) {
  const SurfacePoints points = beside_the_ray(sun(10));
  EXPECT_TRUE(shadowed(ShadowMap(mesh(), sun(60)), points).empty());
  EXPECT_TRUE(shadowed(ShadowMap(mesh(), sun(170)), points).empty());
}

// Points behind the cliff's edge at distances of 20 to 320 m, so that the edge is so many radii above the disc's
// middle.
TEST_F(ShadowMapTest, DiscIsPartlyVisibleBehindAnEdge) {
  constexpr double kElevation_deg = 10;
  Sun from;
  from.direction = sun(kElevation_deg), from.angular_radius_deg = 0.2666;
  const DiscLight disc(from, mesh().anchor());
  const ShadowMap map(mesh(), disc);
  for (const double radii : {-3.0, -0.9, -0.5, 0.0, 0.3, 0.8, 1.2, 1.5, 4.0}) {
    const Vec3 toward_edge = disc.direction(0, radii), edge = to_cartesian({kEdge_deg, 1e-4, kCliff_m});
    SurfacePoints p{};
    for (int i = 0; i < kPacket; ++i) {
      const Vec3 at = edge - (20 + 20 * i) * toward_edge;
      p.hit[i] = true, p.x[i] = at.x(), p.y[i] = at.y(), p.z[i] = at.z();
    }
    LightLanes lanes;
    map.place(p, lanes);
    std::vector<LightSamples> samples(1);
    samples[0].clear(kPacket);
    samples[0].disc.clear(kPacket, false);
    DiscLanes turned{};
    turned.facing_all = kAllLanes;
    std::fill_n(turned.tilt_upward, kPacket, static_cast<float>(disc.radius() / from.direction.x()));
    samples[0].disc.add_packet(0, lanes, turned);
    samples[0].add_packet(lanes, 0);
    samples[0].bound();
    LightScratch scratch;
    map.cast(samples, scratch, {});
    std::vector<double> share(kPacket, 1);
    for (const auto& band : scratch.shadowed)
      for (const std::uint32_t at : band) share[at] = 0;
    for (const auto& band : scratch.partly)
      for (const PartlyLit& left : band) share[left.pixel] = static_cast<double>(left.share);
    const double h = std::clamp(radii, -1.0, 1.0);
    const double expected = (std::acos(h) - h * std::sqrt(1 - h * h)) / 3.14159265358979;
    // The edge is a chord of the Moon, and straight in the sky to a hundredth of a radius.
    for (std::size_t i = 0; i < kPacket; ++i) EXPECT_NEAR(share[i], expected, 0.01) << radii << " " << i;
  }
}

}  // namespace
}  // namespace selenograph::engine
