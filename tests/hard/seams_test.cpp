// Rays aimed at every kind of seam: tile borders, level borders, block corners, the date line and the poles. None
// passes.
//
// The scenes are closed around what is aimed at, so every ray must meet the surface; rays from steep directions must
// meet it where they were aimed, since nothing that steep stands in the way. (unit.mesh matches edges bit by bit.)
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "dem/sample/sample_terrain.h"
#include "dem/terrain/pyramid_terrain.h"
#include "engine/camera/view.h"
#include "engine/scene/anchor.h"
#include "engine/scene/selection.h"
#include "engine/visibility/points/scene.h"
#include "engine/visibility/points/trace.h"
#include "tests/support/shared_data.h"
#include "tests/support/tiles.h"

namespace selenograph::engine {
namespace {

using dem::BlockExtent;
using dem::BlockId;
using dem::kLatTicks;
using dem::kLonTicks;
using test::TemporaryFolder;

constexpr double kOneDegree = std::numbers::pi / 180;
constexpr int kScenes = 6;
// A quarter of a million rays; slow.seams has ten million.
std::int64_t rays_per_scene() {
  const char* const in_all = std::getenv("SELENOGRAPH_TEST_RAYS");
  return ((in_all ? std::atoll(in_all) : 250'000) + kScenes - 1) / kScenes;
}

std::shared_ptr<dem::PyramidTerrain> terrain_of(const std::string& folder) {
  return std::make_shared<dem::PyramidTerrain>(dem::Catalogue(std::vector<std::string>{folder}), dem::TerrainOptions{});
}

// Slopes up to about 15 degrees at every scale that the posts resolve.
double rolling(double lat_deg, double lon_deg) {
  const Vec3 p = to_cartesian({lat_deg, lon_deg, 0}) / 1000;  // km: even around a pole
  double height = 0;
  for (const double wave_km : {80.0, 23.0, 7.0})
    height += 0.02 * wave_km * 1000 * std::sin(p.x() / wave_km * 2 + 0.7) * std::sin(p.y() / wave_km * 2 + 1) *
              std::cos(p.z() / wave_km * 2);
  return height;
}

// ---- selections ----------------------------------------------------------------------------------------------------

Selection selection_of(const dem::Terrain& terrain, std::vector<BlockId> ids) {
  Selection s;
  for (const BlockId& id : ids) {
    const dem::NodeInfo node = terrain.node(id);
    if (node.empty) continue;
    s.blocks.push_back(id);
    s.highest_m = std::max(s.highest_m, static_cast<double>(node.max_m));
  }
  std::sort(s.blocks.begin(), s.blocks.end());
  return s;
}

// Blocks of a level that overlap a box; west may be below -180.
std::vector<BlockId> blocks_in(int level, double south_deg, double north_deg, double west_deg, double east_deg) {
  std::set<BlockId> found;
  const auto tick = [](double deg) { return static_cast<std::int64_t>(std::llround(deg * dem::kTicksPerDegree)); };
  const BlockExtent probe = dem::extent_of({level, dem::rows_of(level) / 2, 0});
  const std::int64_t row_step = std::int64_t{probe.quads} * probe.lat_step, column_step = row_step / 2;
  for (std::int64_t lat = tick(south_deg + 90); lat < tick(north_deg + 90); lat += row_step)
    for (std::int64_t lon = tick(west_deg + 180); lon < tick(east_deg + 180); lon += column_step)
      found.insert(dem::block_at(level, static_cast<dem::Tick>(lat), dem::wrap_lon(lon)));
  return {found.begin(), found.end()};
}

// Every other block, as on a chessboard, in four.
std::vector<BlockId> chessboard(const std::vector<BlockId>& blocks) {
  std::vector<BlockId> mixed;
  for (const BlockId& id : blocks) {
    if ((id.row + id.col) % 2 == 0) {
      mixed.push_back(id);
      continue;
    }
    for (const BlockId& child : dem::children_of(id)) mixed.push_back(child);
  }
  return mixed;
}

// What a wide-angle camera that looks straight down needs: fine below it, coarser all around.
Selection seen_from(const dem::Terrain& terrain, const Vec3& position, double max_error_px) {
  const EastNorthUp axes = local_axes(position);
  const auto camera_from_moon = Mat3::from_rows(axes.east, -axes.north, -axes.up);
  const View view({512, 512, 100, 100, 255.5, 255.5, {}}, {position, Quat(camera_from_moon)});
  return select_for_view(terrain, view, nullptr, {.max_error_px = max_error_px}, StopToken());
}

// ---- seams of a scene ----------------------------------------------------------------------------------------------

struct Tick {
  std::int64_t lat, lon;
};

// The outline of a block as a closed loop of vertices, counter-clockwise from its south-west corner.
struct Outline {
  std::vector<Vec3> vertices;
  std::vector<Tick> ticks;
};

Outline outline_of(const MeshBlock& b) {
  const BlockExtent& e = b.posts->extent;
  const int n = e.quads;
  Outline outline;
  const auto add = [&](int r, int c) {
    outline.vertices.push_back(b.vertex(r, c));
    outline.ticks.push_back({e.lat0 + std::int64_t{r} * e.lat_step, e.lon0 + std::int64_t{c} * e.lon_step});
  };
  for (int i = 0; i < n; ++i) add(0, i);
  for (int i = 0; i < n; ++i) add(i, n);
  for (int i = n; i > 0; --i) add(n, i);
  for (int i = n; i > 0; --i) add(i, 0);
  return outline;
}

// Something to aim at: a piece of an edge from one vertex to the next.
struct Seam {
  Vec3 from, to;
};

// Seams around the globe's features have names, so that none is forgotten.
struct Seams {
  std::vector<Seam> all, corners, date_line, poles, tile_borders, level_borders;
};

bool finite(const Vec3& p) { return p.is_finite(); }

// Whether the four posts around a tick are there.
bool has_posts(const MeshBlock& b, std::int64_t lat, std::int64_t lon) {
  const BlockExtent& e = b.posts->extent;
  const auto r = static_cast<int>(std::clamp<std::int64_t>((lat - e.lat0) / e.lat_step, 0, e.quads - 1)),
             c = static_cast<int>(std::clamp<std::int64_t>((dem::wrap_lon(lon) - e.lon0) / e.lon_step, 0, e.quads - 1));
  return finite(b.vertex(r, c)) && finite(b.vertex(r, c + 1)) && finite(b.vertex(r + 1, c)) &&
         finite(b.vertex(r + 1, c + 1));
}

// Posts that end inside of a block: the mosaic's outermost rows and columns.
void add_rim_within(const MeshBlock& b, std::vector<Vec3>& rim) {
  const int n = b.posts->extent.quads;
  for (int r = 0; r <= n; ++r)
    for (int c = 0; c <= n; ++c) {
      if (!finite(b.vertex(r, c))) continue;
      if ((r > 0 && !finite(b.vertex(r - 1, c))) || (r < n && !finite(b.vertex(r + 1, c))) ||
          (c > 0 && !finite(b.vertex(r, c - 1))) || (c < n && !finite(b.vertex(r, c + 1))))
        rim.push_back(b.vertex(r, c));
    }
}

// What is near a mesh's rim; cells of half the margin keep this from being quadratic.
class NearRim {
 public:
  NearRim(const std::vector<Vec3>& rim, double margin_m) : cell_m_(margin_m / 2) {
    for (const Vec3& p : rim) {
      const auto c = cell(p);
      for (long x = -2; x <= 2; ++x)
        for (long y = -2; y <= 2; ++y)
          for (long z = -2; z <= 2; ++z) near_.insert({c[0] + x, c[1] + y, c[2] + z});
    }
  }
  bool holds(const Vec3& p) const { return near_.contains(cell(p)); }

 private:
  std::array<long, 3> cell(const Vec3& p) const {
    return {std::lround(p.x() / cell_m_), std::lround(p.y() / cell_m_), std::lround(p.z() / cell_m_)};
  }

  double cell_m_;
  std::set<std::array<long, 3>> near_;
};

// Of the blocks' outlines, what lies inside of the mesh (a block on either side) and at least `margin_m` from its rim.
Seams seams_of(const Mesh& mesh, double margin_m) {
  Seams seams;
  std::vector<Vec3> rim;
  struct Found {
    Seam seam;
    Tick at;
    bool corner, levels;
  };
  std::vector<Found> found;
  for (std::uint32_t own = 0; own < mesh.blocks().size(); ++own) {
    const MeshBlock& b = mesh.blocks()[own];
    const BlockExtent& e = b.posts->extent;
    const Outline o = outline_of(b);
    for (std::size_t i = 0; i < o.vertices.size(); ++i) {
      const Vec3 &from = o.vertices[i], &to = o.vertices[(i + 1) % o.vertices.size()];
      const Tick t = o.ticks[i], next = o.ticks[(i + 1) % o.ticks.size()];
      // The tick just across the middle of this piece.
      const std::int64_t south = t.lat == e.lat0 && next.lat == e.lat0 ? -1 : 0,
                         west = t.lon == e.lon0 && next.lon == e.lon0 ? -1 : 0;
      const std::int64_t lat = std::min(t.lat, next.lat) + south, lon = std::min(t.lon, next.lon) + west;
      const bool pole = t.lat == next.lat && (t.lat == 0 || t.lat == kLatTicks);
      const auto across = pole ? std::optional(own) : mesh.block_at(lat, lon);
      if (!finite(from) || !finite(to)) continue;
      if (!across || (!pole && !has_posts(mesh.blocks()[*across], lat, lon))) {
        rim.push_back(from);
        continue;
      }
      const bool levels = mesh.blocks()[*across].posts->id.level != b.posts->id.level ||
                          mesh.blocks()[*across].posts->extent.lon_step != e.lon_step;
      const std::size_t side = static_cast<std::size_t>(e.quads);
      found.push_back({{from, to}, t, i % side == 0, levels});
    }
    add_rim_within(b, rim);
  }
  const NearRim near_rim(rim, margin_m);
  for (const Found& f : found) {
    if (near_rim.holds(f.seam.from)) continue;
    seams.all.push_back(f.seam);
    if (f.corner) seams.corners.push_back(f.seam);
    if (f.levels) seams.level_borders.push_back(f.seam);
    if (f.at.lon % kLonTicks == 0) seams.date_line.push_back(f.seam);
    if (f.at.lat == 0 || f.at.lat == kLatTicks) seams.poles.push_back(f.seam);
    if (f.at.lat % dem::kTicksPerDegree == 0 || f.at.lon % dem::kTicksPerDegree == 0)
      seams.tile_borders.push_back(f.seam);
  }
  return seams;
}

// ---- rays ----------------------------------------------------------------------------------------------------------

struct Tally {
  std::int64_t rays = 0, passed = 0, overshot = 0;
  double overshot_m = 0;
  void add(const Tally& o) {
    rays += o.rays, passed += o.passed, overshot += o.overshot, overshot_m = std::max(overshot_m, o.overshot_m);
  }
};

constexpr double kSteep_deg = 35, kFlattest_deg = 65;

struct Aim {
  Vec3 origin, direction;
  double distance_m;
  bool steep;
};

using Random = std::mt19937_64;
double random_in(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

// A vertex, a place on the edge, or within millimetres of either; from straight above to well aslant, from 200 m to 400
// 000 km.
Aim aim_at(const Seam& seam, double highest_m, Random& random) {
  const std::uint64_t kind = random();
  Vec3 target = kind & 1 ? seam.from : Vec3(seam.from + random_in(random, 0, 1) * (seam.to - seam.from));
  const EastNorthUp axes = local_axes(target);
  if (kind & 2) {
    const double reach_m = std::pow(10.0, random_in(random, -9, -3));
    target += reach_m * (random_in(random, -1, 1) * axes.east + random_in(random, -1, 1) * axes.north);
  }
  const bool steep = kind & 4;
  const double zenith = random_in(random, 0, steep ? kSteep_deg : kFlattest_deg) * kOneDegree,
               azimuth = random_in(random, 0, 2 * std::numbers::pi);
  const Vec3 back =
      std::cos(zenith) * axes.up + std::sin(zenith) * (std::cos(azimuth) * axes.north + std::sin(azimuth) * axes.east);
  const double climb_m = highest_m - (target.norm() - kMoonRadius_m) +
                         std::pow(10.0, (kind & 56) == 0 ? random_in(random, 5, 8.6) : random_in(random, 2.3, 5));
  const double distance_m = climb_m / std::cos(zenith);
  const Vec3 origin = target + distance_m * back;
  const Vec3 direction = target - origin;
  return {origin, direction.normalized(), direction.norm(), steep};
}

// Packets mix kinds of seams and directions.
Tally shoot(const Scene& scene, const std::vector<const std::vector<Seam>*>& seams, std::int64_t count) {
  const double highest_m = scene.shell_m - kMoonRadius_m;
  const std::int64_t packets = (count + kPacket - 1) / kPacket;
  return tbb::parallel_reduce(
      tbb::blocked_range<std::int64_t>(0, packets, 1024), Tally{},
      [&](const tbb::blocked_range<std::int64_t>& range, Tally tally) {
        for (std::int64_t p = range.begin(); p < range.end(); ++p) {
          Random random(static_cast<std::uint64_t>(p) * 0x9E3779B97F4A7C15u + 1);
          std::array<Aim, kPacket> aims;
          Rays rays;
          for (int i = 0; i < kPacket; ++i) {
            const std::vector<Seam>& some = *seams[random() % seams.size()];
            aims[static_cast<std::size_t>(i)] = aim_at(some[random() % some.size()], highest_m, random);
            rays.set(i, aims[static_cast<std::size_t>(i)].origin, aims[static_cast<std::size_t>(i)].direction);
          }
          SurfacePoints points;
          trace(scene, rays, points);
          for (int i = 0; i < kPacket; ++i) {
            const Aim& aim = aims[static_cast<std::size_t>(i)];
            ++tally.rays;
            if (!points.hit[i]) {
              ++tally.passed;
              continue;
            }
            // Aimed to within a millimetre; float chooses among triangles within centimetres on the far ones.
            const double beyond_m = points.distance[i] - aim.distance_m;
            if (!aim.steep) continue;
            tally.overshot_m = std::max(tally.overshot_m, beyond_m);
            tally.overshot += beyond_m > 0.05;
          }
        }
        return tally;
      },
      [](Tally a, const Tally& b) {
        a.add(b);
        return a;
      });
}

struct Wanted {
  const char* name;
  std::vector<Seam> Seams::*list;
};

void expect_closed(const std::string& name, const dem::Terrain& terrain, const Selection& selection,
                   const Vec3& anchor_at, double margin_m, const std::vector<Wanted>& wanted) {
  const Scene scene(terrain, {selection.blocks, anchor_for(anchor_at, -anchor_at.normalized())}, 0);
  const Seams seams = seams_of(scene.mesh, margin_m);
  // Half of the rays anywhere, the others on what is wanted: a ray to a pole meets thousands of slivers and takes its
  // time.
  std::vector<const std::vector<Seam>*> lists(std::max<std::size_t>(wanted.size(), 1), &seams.all);
  std::string counted = fmt::format("{} seams", seams.all.size());
  for (const Wanted& w : wanted) {
    lists.push_back(&(seams.*w.list));
    counted += fmt::format(", {} {}", lists.back()->size(), w.name);
  }
  for (const auto* list : lists) ASSERT_FALSE(list->empty()) << counted;
  const Tally tally = shoot(scene, lists, rays_per_scene());
  fmt::print("{}: {} blocks of levels {}..{}, {}; {} rays, {} passed, steep ones at most {:.1e} m beyond\n", name,
             scene.mesh.blocks().size(), scene.mesh.blocks().front().posts->id.level,
             scene.mesh.blocks().back().posts->id.level, counted, tally.rays, tally.passed, tally.overshot_m);
  EXPECT_GE(tally.rays, rays_per_scene());
  EXPECT_EQ(tally.passed, 0);
  EXPECT_EQ(tally.overshot, 0);
}

// ---- scenes --------------------------------------------------------------------------------------------------------

// The sample's mosaic and its tiles at the date line, made once.
class SampleSeams : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    dem::SampleOptions options;
    options.south_deg = -11, options.west_deg = 43, options.rows = 2, options.columns = 2;
    options.posts_per_degree = 512;
    options.date_line = true;
    dem::write_sample_terrain(folder_->path(), options);
    terrain_ = terrain_of(folder_->path());
  }
  static void TearDownTestSuite() {
    terrain_.reset();
    delete folder_;
    folder_ = nullptr;
  }
  static const dem::Terrain& terrain() { return *terrain_; }
  static Vec3 middle() { return to_cartesian({-10, 44, 5000}); }

 private:
  static inline TemporaryFolder* folder_ = nullptr;
  static inline std::shared_ptr<dem::PyramidTerrain> terrain_;
};

constexpr double kMosaicMargin_m = 12000;  // rays at 65 degrees from the vertical cross 2.1 times the relief

TEST_F(SampleSeams, TileBorders) {
  expect_closed("tile borders", terrain(), selection_of(terrain(), blocks_in(9, -11, -9, 43, 45)), middle(),
                kMosaicMargin_m, {{"on tile borders", &Seams::tile_borders}, {"block corners", &Seams::corners}});
}

TEST_F(SampleSeams, LevelBordersOfAView) {
  const Selection selection = seen_from(terrain(), to_cartesian({-10, 44, 15000}), 1.0);
  expect_closed("levels of a view", terrain(), selection, middle(), kMosaicMargin_m,
                {{"on level borders", &Seams::level_borders}, {"block corners", &Seams::corners}});
}

TEST_F(SampleSeams, LevelBordersOfAChessboard) {
  expect_closed("chessboard of levels", terrain(), selection_of(terrain(), chessboard(blocks_in(8, -11, -9, 43, 45))),
                middle(), kMosaicMargin_m,
                {{"on level borders", &Seams::level_borders},
                 {"block corners", &Seams::corners},
                 {"on tile borders", &Seams::tile_borders}});
}

// Tiles of the sample beside the date line are a degree wide each: too near to their rim for slanting rays. These are
// made for it.
TEST(Seams, DateLine) {
  TemporaryFolder folder;
  for (const int west : {178, 179, 180, 181})
    test::write_kaguya_tile(folder.path(), 42, west, 1, 256, rolling),
        test::write_kaguya_tile(folder.path(), 41, west, 1, 256, rolling);
  const auto terrain = terrain_of(folder.path());
  expect_closed("date line", *terrain, selection_of(*terrain, chessboard(blocks_in(7, 40, 42, 178, 182))),
                to_cartesian({41, 180, 5000}), 8000,
                {{"on the date line", &Seams::date_line}, {"block corners", &Seams::corners}});
}

// All longitudes down to 8 degrees from a pole, where the longitude step doubles twice on the way.
class PolarSeams : public ::testing::Test {
 protected:
  static void expect_closed_cap(const char* name, bool north) {
    TemporaryFolder folder;
    for (int west = 0; west < 360; west += 8)
      test::write_kaguya_tile(folder.path(), north ? 90 : -82, west, 8, 64, rolling);
    const auto terrain = terrain_of(folder.path());
    const auto blocks = north ? blocks_in(5, 82, 90, -180, 180) : blocks_in(5, -90, -82, -180, 180);
    expect_closed(name, *terrain, selection_of(*terrain, chessboard(blocks)),
                  to_cartesian({north ? 89.9 : -89.9, 0, 20000}), 12000,
                  {{"at the pole", &Seams::poles},
                   {"on the date line", &Seams::date_line},
                   {"on level borders", &Seams::level_borders},
                   {"block corners", &Seams::corners}});
  }
};

TEST_F(PolarSeams, North) { expect_closed_cap("north pole", true); }
TEST_F(PolarSeams, South) { expect_closed_cap("south pole", false); }

// Up to its outermost posts a mosaic is there: the middles of all triangles whose posts are valid are met from above.
TEST_F(SampleSeams, TheMosaicReachesItsRim) {
  const Scene scene(
      terrain(),
      {selection_of(terrain(), blocks_in(9, -11, -9, 43, 45)).blocks, anchor_for(middle(), -middle().normalized())}, 0);
  std::vector<Vec3> middles;
  for (std::uint32_t b = 0; b < scene.mesh.blocks().size(); ++b) {
    const int quads = scene.mesh.blocks()[b].posts->extent.quads;
    for (int r = 0; r < quads; ++r)
      for (int c = 0; c < quads; ++c) {
        const dem::Triangle lower =
            scene.mesh.triangle({b, static_cast<std::uint16_t>(r), static_cast<std::uint16_t>(c), false});
        const dem::Triangle upper =
            scene.mesh.triangle({b, static_cast<std::uint16_t>(r), static_cast<std::uint16_t>(c), true});
        if (!finite(lower.a + lower.b + lower.c + upper.a)) continue;  // of a quad with a hole neither half is promised
        middles.push_back((lower.a + lower.b + lower.c) / 3), middles.push_back((upper.a + upper.b + upper.c) / 3);
      }
  }
  ASSERT_GT(middles.size(), 2'000'000u);
  std::size_t missed = 0;
  for (std::size_t first = 0; first < middles.size(); first += kPacket) {
    Rays rays;
    for (std::size_t i = 0; i < kPacket; ++i) {
      const Vec3& m = middles[std::min(first + i, middles.size() - 1)];
      rays.set(static_cast<int>(i), m * (1 + 20000 / m.norm()), -m.normalized());
    }
    SurfacePoints points;
    trace(scene, rays, points);
    for (int i = 0; i < kPacket; ++i) missed += !points.hit[i];
  }
  EXPECT_EQ(missed, 0u) << "of " << middles.size();
}

// The test of the test: with two neighbouring blocks left out, rays at the edge that was random_in them pass.
TEST_F(SampleSeams, DetectsMissingBlocks) {
  Selection selection = selection_of(terrain(), blocks_in(9, -11, -9, 43, 45));
  const Scene whole(terrain(), {selection.blocks, anchor_for(middle(), -middle().normalized())}, 0);
  const Seams seams = seams_of(whole.mesh, kMosaicMargin_m);
  const std::size_t before = selection.blocks.size();
  for (const double lon_deg : {44.05, 44.15})
    std::erase(selection.blocks, dem::block_at(9, static_cast<dem::Tick>((90 - 9.95) * dem::kTicksPerDegree),
                                               static_cast<dem::Tick>((180 + lon_deg) * dem::kTicksPerDegree)));
  ASSERT_EQ(selection.blocks.size(), before - 2);
  const Scene torn(terrain(), {selection.blocks, whole.anchor}, 0);
  EXPECT_GT(shoot(torn, {&seams.all}, 200'000).passed, 0);
}

}  // namespace
}  // namespace selenograph::engine
