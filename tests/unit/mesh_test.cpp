// One continuous mesh: where blocks meet, they meet in the same vertices, bit for bit.
#include "engine/scene/mesh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <set>
#include <unordered_map>

#include "engine/scene/raster_mesh.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;
using test::TemporaryFolder;

double rough(double lat, double lon) {
  return std::abs(lat) > 89.99
             ? 100
             : 2000 * std::sin(lat * 61 + 3 * std::cos(lon * 23)) + 1500 * std::cos(lon * 97 + lat * 13) +
                   700 * std::sin(lon * 311) * std::cos(lat * 503);
}

using Point = std::array<double, 3>;
Point key(const Vec3& p) { return {p.x(), p.y(), p.z()}; }
using Edge = std::pair<Point, Point>;
struct EdgeHash {
  std::size_t operator()(const Edge& e) const {
    std::size_t h = 0;
    for (const Point* p : {&e.first, &e.second})
      for (const double x : *p) h = (h ^ std::hash<double>()(x)) * 0x9E3779B97F4A7C15ULL;
    return h;
  }
};

// Every edge of a watertight piece of mesh is walked once in each direction, except along its outer border. Counts the
// edges that aren't, and that don't lie on the border as told.
std::size_t open_edges(const Mesh& mesh, const std::function<bool(const Geographic&)>& on_border) {
  std::unordered_map<Edge, int, EdgeHash> walks;
  for (std::uint32_t b = 0; b < mesh.blocks().size(); ++b) {
    const int quads = mesh.blocks()[b].posts->extent.quads;
    for (int r = 0; r < quads; ++r)
      for (int c = 0; c < quads; ++c)
        for (const bool upper : {false, true}) {
          const dem::Triangle t =
              mesh.triangle({b, static_cast<std::uint16_t>(r), static_cast<std::uint16_t>(c), upper});
          if (!t.a.is_finite() || !t.b.is_finite() || !t.c.is_finite()) continue;
          const Point p[3] = {key(t.a), key(t.b), key(t.c)};
          if (p[0] == p[1] || p[1] == p[2] || p[2] == p[0]) continue;  // collapsed
          for (int k = 0; k < 3; ++k) {
            ++walks[{p[k], p[(k + 1) % 3]}];
            --walks[{p[(k + 1) % 3], p[k]}];
          }
        }
  }
  std::size_t open = 0;
  for (const auto& [edge, n] : walks) {
    if (n == 0) continue;
    const Geographic a = to_geographic({edge.first[0], edge.first[1], edge.first[2]}),
                     b = to_geographic({edge.second[0], edge.second[1], edge.second[2]});
    if (!(on_border(a) && on_border(b))) ++open;
  }
  return open;
}

BlockId at(int level, double lat, double lon) {
  return dem::block_at(level, static_cast<dem::Tick>(std::lround((lat + 90) * dem::kTicksPerDegree)),
                       dem::wrap_lon(std::llround((lon + 180) * dem::kTicksPerDegree)));
}

// All blocks of a box at one level; `split` asks which of them are to be replaced by their children.
std::vector<BlockId> box(int level, double south, double north, double west, double east,
                         const std::function<bool(const BlockId&)>& split) {
  std::set<BlockId> chosen;
  const dem::BlockExtent first = dem::extent_of(at(level, south, west));
  const double side = static_cast<double>(first.lat1() - first.lat0) / dem::kTicksPerDegree;
  for (double lat = south + side / 2; lat < north; lat += side)
    for (double lon = west + side / 2; lon < east; lon += side) {
      const BlockId id = at(level, lat, lon);
      if (!split(id))
        chosen.insert(id);
      else
        for (const BlockId& child : dem::children_of(id)) chosen.insert(child);
    }
  return {chosen.begin(), chosen.end()};
}

bool pseudo_random(const BlockId& id) { return (dem::BlockIdHash()(id) * 0x9E3779B97F4A7C15ULL >> 60) < 7; }

class MeshTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    test::write_global_tile(*folder_ / "dem", 4, rough);
    terrain_ = test::open_terrain(*folder_ / "dem");
  }
  static void TearDownTestSuite() {
    terrain_.reset();
    delete folder_;
  }
  static TemporaryFolder* folder_;
  static std::shared_ptr<dem::PyramidTerrain> terrain_;
};
TemporaryFolder* MeshTest::folder_ = nullptr;
std::shared_ptr<dem::PyramidTerrain> MeshTest::terrain_;

auto border(double south, double north, double west, double east) {
  return [=](const Geographic& g) {
    const double lon = g.lon_deg < west - 1e-6 ? g.lon_deg + 360 : g.lon_deg;
    return std::min({std::abs(g.lat_deg - south), std::abs(g.lat_deg - north), std::abs(lon - west),
                     std::abs(lon - east)}) < 1e-9;
  };
}

TEST_F(MeshTest, OneLevelIsClosed) {
  const Mesh mesh(*terrain_, box(5, 2, 10, 20, 28, [](const BlockId&) { return false; }));
  ASSERT_EQ(mesh.blocks().size(), 16U);
  EXPECT_EQ(open_edges(mesh, border(2, 10, 20, 28)), 0U);
  EXPECT_GT(open_edges(mesh, [](const Geographic&) { return false; }), 0U) << "the border itself must show";
}

TEST_F(MeshTest, MixedLevelsWithCornersInEdgesAreClosed) {
  const auto blocks = box(5, 2, 10, 20, 28, pseudo_random);
  std::set<int> levels;
  for (const BlockId& id : blocks) levels.insert(id.level);
  ASSERT_EQ(levels.size(), 2U);
  EXPECT_EQ(open_edges(Mesh(*terrain_, blocks), border(2, 10, 20, 28)), 0U);
}

TEST_F(MeshTest, AcrossTheDateLine) {
  EXPECT_EQ(open_edges(Mesh(*terrain_, box(5, 2, 10, 176, 184, pseudo_random)), border(2, 10, 176, 184)), 0U);
}

TEST_F(MeshTest, WhereLongitudeStepsDoubleIsClosed) {
  // The pole, where the outer meridians meet, is border too. Steps double at 78 degrees, between
  // pyramid chunks that filter along different steps, and again nearer the pole.
  for (const double sign : {1.0, -1.0})
    for (const int level : {2, 3, 4}) {
      const double south = sign > 0 ? 74 : -90, north = sign > 0 ? 90 : -74;
      const auto edge = border(sign > 0 ? 74 : -74, sign * 90, 20, 36);
      EXPECT_EQ(
          open_edges(Mesh(*terrain_, box(level, south, north, 20, 36, [](const BlockId&) { return false; })), edge), 0U)
          << level;
      EXPECT_EQ(open_edges(Mesh(*terrain_, box(level, south, north, 20, 36, pseudo_random)), edge), 0U) << level;
    }
}

TEST_F(MeshTest, CoarseLevelsAreClosed) {
  EXPECT_EQ(open_edges(Mesh(*terrain_, box(1, 74, 90, -180, 180, [](const BlockId&) { return false; })),
                       border(74, 1000, 1000, 1000)),
            0U);
  EXPECT_EQ(open_edges(Mesh(*terrain_, box(2, -90, -74, -180, 180, pseudo_random)), border(-74, 1000, 1000, 1000)), 0U);
}

TEST_F(MeshTest, APoleIsOnePoint) {
  const auto blocks = box(3, 82, 90, -180, 180, pseudo_random);
  const Mesh mesh(*terrain_, blocks);
  for (const MeshBlock& b : mesh.blocks()) {
    if (b.posts->extent.lat1() != dem::kLatTicks) continue;
    for (int c = 0; c <= b.posts->extent.quads; ++c)
      ASSERT_EQ(b.vertex(b.posts->extent.quads, c), Vec3(0, 0, kMoonRadius_m + 100));
  }
  EXPECT_EQ(open_edges(mesh, border(82, 1000, 1000, 1000)), 0U);
}

TEST_F(MeshTest, FindsTheBlockOfAPlace) {
  const auto blocks = box(5, 2, 10, 20, 28, pseudo_random);
  const Mesh mesh(*terrain_, blocks);
  for (std::uint32_t i = 0; i < mesh.blocks().size(); ++i) {
    const dem::BlockExtent& e = mesh.blocks()[i].posts->extent;
    EXPECT_EQ(mesh.block_at(e.lat0, e.lon0), i);
    EXPECT_EQ(mesh.block_at(e.lat1() - 1, std::int64_t{e.lon1()} - 1 - dem::kLonTicks), i);
  }
  EXPECT_FALSE(mesh.block_at(-1, 0));
  EXPECT_FALSE(mesh.block_at(0, 0));
}

TEST_F(MeshTest, TwoLayersOfPostsJoinAtTheirBorder) {
  TemporaryFolder folder;
  test::write_float_tile(folder.path(), "coarse", {20, 0, 4, 81, 81}, rough);
  test::write_float_tile(folder.path(), "fine", {12, 8, 32, 4 * 32 + 1, 4 * 32 + 1}, rough,
                         [](double lat, double lon) { return std::hypot(lat - 10, lon - 12) < 0.7; });
  const auto terrain = test::open_terrain(folder.path());
  EXPECT_EQ(open_edges(Mesh(*terrain, box(5, 6, 14, 4, 16, pseudo_random)), border(6, 14, 4, 16)), 0U);
}

// A mesh that takes over blocks of another one, and its drawn form, are what they are when made from nothing.
TEST_F(MeshTest, ReusedBlocksAreIdentical) {
  const Vec3 anchor = to_cartesian({6, 24, 0});
  const auto other_halves = [](const BlockId& id) { return !pseudo_random(id); };
  const std::vector<std::vector<BlockId>> steps{box(5, 2, 10, 20, 28, pseudo_random),
                                                box(5, 2, 10, 22, 30, pseudo_random),  // a step east
                                                box(5, 2, 10, 22, 30, other_halves),   // other levels: all joints anew
                                                box(5, 4, 12, 22, 30, other_halves)};
  std::unique_ptr<Mesh> before;
  std::unique_ptr<RasterMesh> drawn_before;
  const auto parts_before = [&](const Vec3& at) { return drawn_before ? drawn_before->parts_for(at) : RasterParts{}; };
  std::size_t shared = 0, made = 0;
  for (const auto& blocks : steps) {
    auto mesh = std::make_unique<Mesh>(*terrain_, blocks, before.get());
    auto drawn = std::make_unique<RasterMesh>(*mesh, anchor, parts_before(anchor));
    const Mesh fresh(*terrain_, blocks);
    const RasterMesh fresh_drawn(fresh, anchor);
    ASSERT_EQ(mesh->blocks().size(), fresh.blocks().size());
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      const MeshBlock &a = mesh->blocks()[i], &b = fresh.blocks()[i];
      bool known = false;
      for (std::size_t k = 0; before && k < before->blocks().size(); ++k) known |= before->share(k) == mesh->share(i);
      ++(known ? shared : made);
      ASSERT_EQ(a.posts->id, b.posts->id);
      ASSERT_TRUE(a.border == b.border);
      ASSERT_EQ(std::memcmp(a.vertices.data(), b.vertices.data(), a.vertices.size() * sizeof(dem::Vertex)), 0);
      const RasterBlock &x = drawn->blocks()[i], &y = fresh_drawn.blocks()[i];
      ASSERT_EQ(std::memcmp(x.x, y.x, sizeof(float) * 3 * static_cast<std::size_t>(x.stride * (x.quads + 1))), 0);
    }
    ASSERT_EQ(drawn->strips().size(), fresh_drawn.strips().size());
    EXPECT_EQ(std::memcmp(drawn->strips().data(), fresh_drawn.strips().data(), drawn->strips().size() * sizeof(Strip)),
              0);
    ASSERT_EQ(drawn->skirts().size(), fresh_drawn.skirts().size());
    EXPECT_EQ(std::memcmp(drawn->skirts().data(), fresh_drawn.skirts().data(), drawn->skirts().size() * sizeof(Skirt)),
              0);
    before = std::move(mesh), drawn_before = std::move(drawn);
  }
  EXPECT_GT(shared, 20U);
  EXPECT_GT(made, 60U);
  // Of another anchor only shapes are taken over.
  const Vec3 other = anchor + Vec3(4096, 0, 0);
  const RasterMesh elsewhere(*before, other, parts_before(other)), fresh(*before, other);
  EXPECT_NE(elsewhere.blocks()[0].x[0], drawn_before->blocks()[0].x[0]);
  for (std::size_t i = 0; i < fresh.pieces().size(); ++i) {
    EXPECT_EQ(elsewhere.pieces()[i]->shape, drawn_before->pieces()[i]->shape);
    const std::vector<float>&a = elsewhere.pieces()[i]->xyz, &b = fresh.pieces()[i]->xyz;
    ASSERT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)), 0);
  }
  ASSERT_EQ(elsewhere.strips().size(), fresh.strips().size());
  EXPECT_EQ(std::memcmp(elsewhere.strips().data(), fresh.strips().data(), fresh.strips().size() * sizeof(Strip)), 0);
  ASSERT_EQ(elsewhere.skirts().size(), fresh.skirts().size());
  EXPECT_EQ(std::memcmp(elsewhere.skirts().data(), fresh.skirts().data(), fresh.skirts().size() * sizeof(Skirt)), 0);
}

// Wherever loading is given up, what it leaves in the terrain's memory is what a fresh one would have.
TEST_F(MeshTest, CancellationLeavesAValidMesh) {
  const auto blocks = box(5, 2, 10, 20, 28, [](const BlockId&) { return true; });
  const Mesh right(*terrain_, blocks);
  const auto opened = [&] {
    auto terrain = test::open_terrain(*folder_ / "dem", *folder_ / "cache");
    terrain->block(blocks[0]);  // with the pyramid around it
    return terrain;
  };
  auto terrain = opened();
  const auto start = StopToken::Clock::now();
  const Mesh whole(*terrain, blocks);
  const auto took = StopToken::Clock::now() - start;
  const int trials = 12;
  int given_up = 0;
  for (int trial = 0; trial < trials; ++trial) {
    terrain = opened();
    try {
      const Mesh part(*terrain, blocks, nullptr, StopToken(StopToken::Clock::now() + took * trial / trials));
    } catch (const Cancelled&) {
      ++given_up;
    }
    const Mesh after(*terrain, blocks);
    ASSERT_EQ(after.blocks().size(), right.blocks().size()) << trial;
    for (std::size_t i = 0; i < blocks.size(); ++i)
      ASSERT_EQ(std::memcmp(after.blocks()[i].vertices.data(), right.blocks()[i].vertices.data(),
                            right.blocks()[i].vertices.size_bytes()),
                0)
          << "block " << to_string(blocks[i]) << " after loading was given up in trial " << trial;
  }
  EXPECT_GT(given_up, 0);
}

// Of every strip: no triangle rises more steeply toward any of the eight directions than is said, and one as steeply.
TEST_F(MeshTest, StripsKnowTheirSteepestTriangles) {
  const Mesh mesh(*terrain_, box(5, 2, 10, 20, 28, pseudo_random));
  const RasterMesh drawn(mesh, to_cartesian({6, 24, 0}));
  std::size_t unknown = 0;
  for (const Strip& strip : drawn.strips()) {
    const MeshBlock& block = mesh.blocks()[strip.block];
    const int quads = block.posts->extent.quads;
    const EastNorthUp axes = local_axes(block.posts->position(strip.first_row + strip.rows / 2, quads / 2, 0));
    std::array<double, 8> steepest;
    steepest.fill(-std::numeric_limits<double>::infinity());
    for (int r = strip.first_row; r < strip.first_row + strip.rows; ++r)
      for (int c = 0; c < quads; ++c)
        for (const bool upper : {false, true}) {
          const dem::Triangle t = mesh.triangle(TriangleId(strip.block, r, c, upper));
          const Vec3 normal = (t.b - t.a).cross(t.c - t.a);
          if (!(normal.norm() > 1e-3)) continue;  // voids, and what has collapsed
          ASSERT_GT(normal.dot(axes.up), 0);
          const double east = -normal.dot(axes.east) / normal.dot(axes.up),
                       north = -normal.dot(axes.north) / normal.dot(axes.up);
          for (std::size_t k = 0; k < 8; ++k) {
            const double azimuth = static_cast<double>(k) * std::numbers::pi / 4;
            steepest[k] = std::max(steepest[k], east * std::cos(azimuth) + north * std::sin(azimuth));
          }
        }
    if (std::isinf(strip.steepest[0])) {
      ++unknown;
      continue;
    }
    for (std::size_t k = 0; k < 8; ++k) EXPECT_NEAR(strip.steepest[k], steepest[k], 1e-4 * (1 + std::abs(steepest[k])));
  }
  EXPECT_GT(drawn.strips().size(), 100U);
  EXPECT_LT(unknown, drawn.strips().size() / 10) << "with very thin triangles";
}

// Skirts hang under the border of the data and nowhere else: as many as that border has edges, two each.
TEST_F(MeshTest, SkirtsHangAtDataBoundariesOnly) {
  for (const auto& split : {std::function<bool(const BlockId&)>([](const BlockId&) { return false; }),
                            std::function<bool(const BlockId&)>(pseudo_random)}) {
    const Mesh mesh(*terrain_, box(5, 2, 10, 20, 28, split));
    const RasterMesh drawn(mesh, to_cartesian({6, 24, 0}));
    const std::size_t edges = open_edges(mesh, [](const Geographic&) { return false; });
    EXPECT_GT(edges, 200U);
    EXPECT_EQ(drawn.skirts().size(), edges) << "which are counted in both directions";
  }
}

}  // namespace
}  // namespace selenograph::engine
