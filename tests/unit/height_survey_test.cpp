// What a look at files says of heights holds of everything that is made of them.
#include "dem/terrain/height_survey.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "dem/terrain/pyramid_terrain.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

double relief(double lat, double lon) {
  return std::round(900 * std::cos(lat * 53 + lon * 29) + 250 * std::sin(lat * 190));
}

using Wanted = std::function<bool(const BlockExtent&)>;

// Every node of the direct chunks of an area, from its own root down.
void visit(const PyramidTerrain& terrain, const BlockId& id, int finest, const Wanted& wanted,
           std::vector<BlockId>& out) {
  if (!terrain.has_data(id) || !wanted(extent_of(id))) return;
  if (terrain.node_is_cheap(id)) out.push_back(id);
  if (id.level < finest)
    for (const BlockId& child : children_of(id)) visit(terrain, child, finest, wanted, out);
}

// Compares with a second terrain that has its pyramids. Returns how much wider surveys are, at most.
double widest(
    const std::string& folder, std::size_t least, const Wanted& wanted = [](const BlockExtent&) { return true; }) {
  const auto looked = test::open_terrain(folder), built = test::open_terrain(folder);
  std::vector<BlockId> nodes;
  for (const BlockId& root : looked->roots()) visit(*looked, root, 8, wanted, nodes);
  double widest_m = 0;
  std::size_t compared = 0;
  for (const BlockId& id : nodes) {
    const auto range = looked->heights_without_building(id);
    const NodeInfo node = built->node(id);
    if (!range || node.empty) continue;
    ++compared;
    EXPECT_LE(range->low, node.min_m) << to_string(id);
    EXPECT_GE(range->high, node.max_m) << to_string(id);
    widest_m = std::max(
        {widest_m, static_cast<double>(node.min_m - range->low), static_cast<double>(range->high - node.max_m)});
  }
  EXPECT_EQ(looked->statistics().chunks_built, 0U) << "looking is not building";
  EXPECT_GE(compared, least);
  return widest_m;
}

TEST(HeightSurvey, BoundsPostsOnTheLattice) {
  const test::TemporaryFolder folder;
  test::write_kaguya_tile(folder.path(), 12, 20, 2, 256, relief);
  EXPECT_LT(widest(folder.path(), 20), 1200);  // blocks look beyond themselves, and relief is of this size
}

TEST(HeightSurvey, BoundsResampledPostsAndBesideVoids) {
  const test::TemporaryFolder folder;
  const auto steps = [](double lat, double lon) {
    return std::fmod(std::floor(lat * 50) + std::floor(lon * 50), 2) * 900;
  };
  const auto is_void = [](double lat, double lon) { return std::hypot(lat - 11.3, lon - 20.6) < 0.05; };
  test::write_float_tile(folder.path(), "a",
                         {.north_deg = 12, .west_deg = 20, .posts_per_degree = 225, .rows = 451, .columns = 226}, steps,
                         is_void);
  // Goes on where the other ends, a cliff higher.
  test::write_float_tile(
      folder.path(), "b",
      {.north_deg = 12, .west_deg = 20 + 226.0 / 225, .posts_per_degree = 225, .rows = 451, .columns = 226},
      [&](double lat, double lon) { return steps(lat, lon) + 3000; });
  widest(folder.path(), 20);
}

TEST(HeightSurvey, BoundsUnderAGlobalLayerAndAcrossTheDateLine) {
  const test::TemporaryFolder folder;
  test::write_float_tile(folder.path(), "global",
                         {.north_deg = 60, .west_deg = -180, .posts_per_degree = 4, .rows = 481, .columns = 1440},
                         [](double lat, double lon) { return 3000 * std::sin(lat / 3) * std::cos(lon / 2); });
  test::write_float_tile(folder.path(), "site",
                         {.north_deg = 1, .west_deg = 179, .posts_per_degree = 64, .rows = 65, .columns = 129}, relief);
  // Around the place where the equator crosses the date line: the rest of the globe is more of the same.
  widest(folder.path(), 300, [](const BlockExtent& e) {
    constexpr Tick kNear = 2 * kTicksPerDegree, kEquator = 90 * kTicksPerDegree;
    return e.lat0 < kEquator + kNear && e.lat1() > kEquator - kNear && (e.lon0 < kNear || e.lon1() > kLonTicks - kNear);
  });
}

TEST(HeightSurvey, UnknownWhereFilesCannotBeRead) {
  const test::TemporaryFolder folder;
  test::write_kaguya_tile(folder.path(), 12, 20, 2, 256, relief);
  const auto terrain = test::open_terrain(folder.path());
  const BlockId id =
      block_at(6, static_cast<Tick>((90 + 11.5) * kTicksPerDegree), static_cast<Tick>(200.5 * kTicksPerDegree));
  EXPECT_TRUE(terrain->heights_without_building(id));
  terrain->node(id);
  EXPECT_FALSE(terrain->heights_without_building(id)) << "node() needs no building any more";
  const auto again = test::open_terrain(folder.path());
  for (const auto& file : std::filesystem::directory_iterator(folder.path()))
    if (file.path().extension() == ".img") std::filesystem::resize_file(file.path(), 100);
  EXPECT_FALSE(again->heights_without_building(id));
}

}  // namespace
}  // namespace selenograph::dem
