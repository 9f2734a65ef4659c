// The pyramid: posts bit for bit at the finest level, slopes through every filter, honest error bounds, files that are
// checked.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <random>
#include <set>

#include "dem/base/error.h"
#include "dem/pyramid/chunk.h"
#include "dem/pyramid/chunk_format.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;
using test::open_terrain;
using test::TemporaryFolder;
using test::write_float_tile;
using test::write_kaguya_tile;

double lat_of(const Block& b, int r) { return lat_deg_of(b.extent.lat0 + r * b.extent.lat_step); }
double lon_of(const Block& b, int c) { return lon_deg_of(b.extent.lon0 + c * b.extent.lon_step); }

// Integer noise that is the same for the same place.
double noise(double lat, double lon) {
  std::uint64_t x =
      static_cast<std::uint64_t>(std::llround((lat + 90) * 4096) * 7919 + std::llround((lon + 360) * 4096)) *
      0x9E3779B97F4A7C15ULL;
  x ^= x >> 29, x *= 0xBF58476D1CE4E5B9ULL, x ^= x >> 32;
  return static_cast<double>(x % 2000) - 1000;
}

std::vector<BlockId> blocks_with_data(const Terrain& terrain, int level) {
  std::vector<BlockId> now = terrain.roots();
  while (!now.empty() && now[0].level < level) {
    std::vector<BlockId> next;
    for (const BlockId& id : now)
      for (const BlockId& child : children_of(id))
        if (terrain.has_data(child)) next.push_back(child);
    now = std::move(next);
  }
  return now;
}

TEST(Pyramid, TheFinestPostsAreTheFilesOnes) {
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 12, 20, 2, 64, noise);
  const auto terrain = open_terrain(folder.path());
  std::size_t posts = 0;
  for (const BlockId& id : blocks_with_data(*terrain, 6)) {
    EXPECT_EQ(terrain->posts_level(id), 6);
    const auto block = terrain->block(id);
    if (!block) continue;
    for (int r = 0; r <= 64; ++r)
      for (int c = 0; c <= 64; ++c) {
        const double lat = lat_of(*block, r), lon = lon_of(*block, c),
                     h = static_cast<double>(block->vertices[block->index(r, c)].height_m);
        const bool inside = lat > 10 && lat <= 12 && lon >= 20 && lon < 22;
        ASSERT_EQ(!std::isnan(h), inside) << lat << ' ' << lon;
        if (!inside) continue;
        ASSERT_EQ(h, noise(lat, lon));
        ASSERT_EQ(block->source(r, c), 0);
        ++posts;
      }
  }
  EXPECT_GE(posts, 128U * 128);
}

TEST(Pyramid, SlopesPassAllFilters) {
  TemporaryFolder folder;
  const auto slope = [](double lat, double lon) { return 64 * lat - 32 * lon + 16; };
  write_float_tile(folder.path(), "t", {30, 0, 32, 32 * 32 + 1, 32 * 32 + 1}, slope);
  const auto terrain = open_terrain(folder.path());
  for (int level = 2; level <= 8; ++level) {
    // Blocks in the middle: at the border the filter finds posts on one side only.
    const BlockId id =
        block_at(level, static_cast<Tick>(105.5 * kTicksPerDegree), static_cast<Tick>(195.5 * kTicksPerDegree));
    const auto block = terrain->block(id);
    ASSERT_TRUE(block);
    for (int r = 0; r <= block->extent.quads; ++r)
      for (int c = 0; c <= block->extent.quads; ++c)
        ASSERT_NEAR(static_cast<double>(block->vertices[block->index(r, c)].height_m),
                    slope(lat_of(*block, r), lon_of(*block, c)), 1e-3)
            << to_string(id);
    EXPECT_LT(terrain->node(id).error_m, 1e-3);
  }
}

TEST(Pyramid, AConstantIsAConstantEverywhereFromPoleToPole) {
  TemporaryFolder folder;
  test::write_global_tile(folder.path(), 2, [](double, double) { return -1234.0; });
  const auto terrain = open_terrain(folder.path());
  for (int level = 0; level <= 4; ++level) {
    std::size_t blocks = 0;
    for (const BlockId& id : blocks_with_data(*terrain, level)) {
      ++blocks;
      if (id.col % 9 != 0) continue;
      const auto block = terrain->block(id);
      ASSERT_TRUE(block) << to_string(id);
      for (const Vertex& v : block->vertices) ASSERT_EQ(v.height_m, -1234.F) << to_string(id);
      EXPECT_EQ(terrain->node(id).error_m, 0);
      EXPECT_EQ(terrain->node(id).min_m, -1234.F);
      EXPECT_EQ(terrain->node(id).max_m, -1234.F);
    }
    std::size_t all = 0;
    for (int row = 0; row < rows_of(level); ++row) all += static_cast<std::size_t>(columns_of(level, row));
    EXPECT_EQ(blocks, all);
    if (level == 1) level = 3;
  }
}

// The height of a block's surface by its triangles, linear in latitude and longitude (the pyramid's own measure).
double surface(const Block& b, double lat_tick, double lon_tick) {
  const double y = (lat_tick - b.extent.lat0) / b.extent.lat_step, x = (lon_tick - b.extent.lon0) / b.extent.lon_step;
  const int r = std::clamp(static_cast<int>(y), 0, b.extent.quads - 1),
            c = std::clamp(static_cast<int>(x), 0, b.extent.quads - 1);
  const double fy = y - r, fx = x - c;
  const auto h = [&](int j, int i) { return static_cast<double>(b.vertices[b.index(r + j, c + i)].height_m); };
  if (fx + fy <= 1) return h(0, 0) + fx * (h(0, 1) - h(0, 0)) + fy * (h(1, 0) - h(0, 0));
  return h(1, 1) + (1 - fx) * (h(1, 0) - h(1, 1)) + (1 - fy) * (h(0, 1) - h(1, 1));
}

void expect_honest_bounds(const Terrain& terrain, double lat, double lon, int finest) {
  std::mt19937 random(9);
  for (int level = finest; level >= 1; --level) {
    const BlockId id = block_at(level, static_cast<Tick>((lat + 90) * kTicksPerDegree),
                                static_cast<Tick>((lon + 180) * kTicksPerDegree));
    const auto block = terrain.block(id);
    ASSERT_TRUE(block);
    const NodeInfo info = terrain.node(id);
    double worst = 0;
    for (int i = 0; i < 20000; ++i) {
      const auto y = block->extent.lat0 +
                     static_cast<Tick>(random() % static_cast<unsigned>(block->extent.lat1() - block->extent.lat0));
      const auto x = block->extent.lon0 +
                     static_cast<Tick>(random() % static_cast<unsigned>(block->extent.lon1() - block->extent.lon0));
      const auto fine = terrain.block(block_at(finest, y, x));
      if (!fine) continue;  // beyond the tile
      const double truth = surface(*fine, y, x), here = surface(*block, y, x);
      if (std::isnan(truth) || std::isnan(here)) continue;
      worst = std::max(worst, std::abs(truth - here));
      ASSERT_LE(std::max(truth, here), static_cast<double>(info.max_m) + 1e-3);
      ASSERT_GE(std::min(truth, here), static_cast<double>(info.min_m) - 1e-3);
    }
    EXPECT_LE(worst, info.error_m + 1e-3) << to_string(id);
    if (level < finest) {
      EXPECT_GE(worst, 0.2 * info.error_m) << to_string(id) << ": far too careful";
    }
  }
}

TEST(Pyramid, ErrorsAndHeightsAreBounded) {
  TemporaryFolder folder;
  write_float_tile(folder.path(), "t", {24, 0, 64, 16 * 64 + 1, 16 * 64 + 1}, noise);
  expect_honest_bounds(*open_terrain(folder.path()), 18.3, 6.2, 6);
}

TEST(Pyramid, ErrorsAreBoundedNearThePole) {
  TemporaryFolder folder;
  write_float_tile(folder.path(), "t", {90, 0, 64, 16 * 64 + 1, 16 * 64 + 1}, noise);
  expect_honest_bounds(*open_terrain(folder.path()), 79.5, 9.2, 6);
}

TEST(Pyramid, ErrorsAreBoundedThroughStackedChunks) {
  // Posts of level 11 under a root at level 4: the root is made of the chunks beneath it.
  TemporaryFolder folder;
  write_kaguya_tile(folder.path(), 20, 1, 1, 2048, [](double lat, double lon) {
    return std::round(300 * std::sin(lat * 300) * std::sin(lon * 200) + 0.02 * noise(lat, lon));
  });
  const auto terrain = open_terrain(folder.path());
  expect_honest_bounds(*terrain, 19.5, 1.5, 11);
}

// Blocks of one level that touch, from whichever chunks: the posts on the common edge agree bit for bit.
void expect_equal_edges(const Terrain& terrain, const BlockId& id) {
  const auto a = terrain.block(id);
  ASSERT_TRUE(a);
  const BlockExtent& e = a->extent;
  const auto compare = [&](const BlockId& other_id) {
    const auto b = terrain.block(other_id);
    if (!b) return;
    for (int r = 0; r <= e.quads; ++r)
      for (int c = 0; c <= e.quads; ++c) {
        const Tick dy = e.lat0 + r * e.lat_step - b->extent.lat0;
        Tick dx = wrap_lon(e.lon0 + std::int64_t{c} * e.lon_step) - b->extent.lon0;
        if (dx < 0) dx += kLonTicks;
        if (dy < 0 || dx > b->extent.quads * b->extent.lon_step || dy > b->extent.quads * b->extent.lat_step ||
            dx % b->extent.lon_step)
          continue;
        const float x = a->vertices[a->index(r, c)].height_m,
                    y = b->vertices[b->index(dy / b->extent.lat_step, dx / b->extent.lon_step)].height_m;
        ASSERT_TRUE(x == y || (std::isnan(x) && std::isnan(y)))
            << x << ' ' << y << ' ' << to_string(id) << " and " << to_string(other_id) << " at " << lat_of(*a, r) << ' '
            << lon_of(*a, c);
      }
  };
  compare(block_at(id.level, e.lat0, wrap_lon(std::int64_t{e.lon0} + e.lon1() - e.lon0)));
  // Where the longitude step changes between chunks, the two filter along different steps; engine/mesh joins them.
  if (e.lat1() < kLatTicks && block_at(id.level, e.lat1(), e.lon0).col == id.col)
    compare(block_at(id.level, e.lat1(), e.lon0));
}

TEST(Pyramid, NeighbouringChunksAgreeOnTheirEdges) {
  TemporaryFolder folder;
  write_float_tile(folder.path(), "t", {24, -12, 64, 24 * 64 + 1, 24 * 64 + 1}, noise);
  const auto terrain = open_terrain(folder.path());
  for (int level = 3; level <= 6; ++level)
    for (const BlockId& id : blocks_with_data(*terrain, level)) expect_equal_edges(*terrain, id);
}

TEST(Pyramid, NeighboursAgreeAroundTheDateLineAndThePole) {
  TemporaryFolder folder;
  test::write_global_tile(folder.path(), 4, noise);
  const auto terrain = open_terrain(folder.path());
  for (const int level : {2, 4})
    for (const BlockId& id : blocks_with_data(*terrain, level)) {
      const BlockExtent e = extent_of(id);
      const bool pole = e.lat0 == 0 || e.lat1() == kLatTicks;
      if (!pole && e.lon1() != kLonTicks) continue;
      if (!pole) {
        expect_equal_edges(*terrain, id);
        continue;
      }
      const auto block = terrain->block(id);
      const int r = e.lat0 == 0 ? 0 : e.quads;
      for (int c = 0; c <= e.quads; ++c)
        ASSERT_EQ(block->vertices[block->index(r, c)].height_m, static_cast<float>(noise(e.lat0 == 0 ? -90 : 90, 0)))
            << to_string(id);
    }
}

class PyramidFile : public ::testing::Test {
 protected:
  PyramidFile() { write_kaguya_tile(folder_ / "dem", 12, 20, 2, 32, noise); }
  std::shared_ptr<PyramidTerrain> open() const { return open_terrain(folder_ / "dem", folder_ / "cache"); }
  std::vector<float> posts(const Terrain& terrain) const {
    std::vector<float> all;
    for (const int level : {4, 5})  // from the pyramid, and from the tile
      for (const BlockId& id : blocks_with_data(terrain, level))
        if (const auto block = terrain.block(id))
          for (const Vertex& v : block->vertices) all.push_back(std::isnan(v.height_m) ? -77777 : v.height_m);
    return all;
  }
  std::vector<std::string> files() const {
    std::vector<std::string> found;
    for (const auto& entry : fs::recursive_directory_iterator(folder_ / "cache"))
      if (entry.is_regular_file()) found.push_back(entry.path().string());
    return found;
  }
  TemporaryFolder folder_;
};

TEST_F(PyramidFile, RoundTrip) {
  const auto first = open();
  const auto built = posts(*first);
  EXPECT_GT(first->statistics().chunks_built, 0U);
  first->wait_until_written();
  const auto again = open();
  EXPECT_EQ(posts(*again), built);
  EXPECT_EQ(again->statistics().chunks_built, 0U);
  EXPECT_GT(again->statistics().chunks_read, 0U);
  for (const std::string& file : files()) EXPECT_EQ(file.find(".tmp-"), std::string::npos) << file;
}

// The posts are in their own files already.
TEST_F(PyramidFile, TakesLessThanTheTiles) {
  const std::string dem = folder_ / "fine";
  write_kaguya_tile(dem, 12, 21, 1, 2048, [](double lat, double lon) {
    return 900 * std::sin(9 * lat) * std::cos(7 * lon) + 2 * std::sin(3000 * lat) * std::sin(2700 * lon);
  });
  const auto terrain = open_terrain(dem, folder_ / "fine-cache");
  terrain->ingest([](std::size_t, std::size_t, const std::string&) { return true; });
  const auto bytes_in = [](const std::string& folder) {
    double sum = 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
      if (entry.is_regular_file()) sum += static_cast<double>(entry.file_size());
    return sum;
  };
  EXPECT_LT(bytes_in(folder_ / "fine-cache"), 0.6 * bytes_in(dem));
  EXPECT_GT(bytes_in(folder_ / "fine-cache"), 0.3 * bytes_in(dem));
}

TEST_F(PyramidFile, EveryRegionIsProtected) {
  const Catalogue catalogue(std::vector<std::string>{folder_ / "dem"});
  const PostSource source(catalogue, false, [](const std::string&, const std::string&) {});
  ChunkPlan plan;
  plan.node = block_at(4, static_cast<Tick>(101 * kTicksPerDegree), static_cast<Tick>(201 * kTicksPerDegree));
  plan.base_level = 5;
  plan.fingerprint = 12345;
  plan.exists = true;
  const std::string good = Chunk::build(plan, catalogue, source).bytes;
  const auto intact = Chunk::from_bytes(good, plan, catalogue);
  std::vector<BlockId> ids{{4, plan.node.row, plan.node.col}, {2, plan.node.row, plan.node.col}};
  for (const BlockId& child : children_of(plan.node)) ids.push_back(child);
  const auto damaged = [&](const std::string& bytes) {
    try {
      const auto chunk = Chunk::from_bytes(bytes, plan, catalogue);
      for (int level = 0; level <= 5; ++level)
        for (const BlockId& id :
             level == 5 ? children_of(plan.node) : std::vector<BlockId>{{level, plan.node.row, plan.node.col}})
          chunk->load(id, source);
      return false;
    } catch (const DataError&) {
      return true;
    }
  };
  ASSERT_FALSE(damaged(good));
  std::mt19937 random(2);
  std::set<std::size_t> places;
  for (std::size_t i = 0; i < sizeof(format::Header) + 800; ++i) places.insert(i);
  for (int i = 0; i < 300; ++i) places.insert(random() % good.size());
  places.insert(good.size() - 1);
  for (const std::size_t at : places) {
    std::string bad = good;
    bad[at] = static_cast<char>(bad[at] ^ (1 << (at % 8)));
    ASSERT_TRUE(damaged(bad)) << "byte " << at << " of " << good.size();
  }
  for (const std::size_t size : {std::size_t{0}, std::size_t{1}, sizeof(format::Header) - 1, sizeof(format::Header),
                                 good.size() / 2, good.size() - 1})
    EXPECT_TRUE(damaged(good.substr(0, size))) << size;
  EXPECT_TRUE(damaged(good + "x"));
}

// Opening a FIFO waits for its writer: without end.
TEST_F(PyramidFile, AFifoInAFilesPlaceIsReplaced) {
  const auto right = posts(*open());
  for (const std::string& file : files()) {
    fs::remove(file);
    ASSERT_EQ(::mkfifo(file.c_str(), 0600), 0);
    const auto terrain = open();
    ASSERT_EQ(posts(*terrain), right) << file;
    terrain->wait_until_written();
    EXPECT_TRUE(fs::is_regular_file(file)) << file;
  }
}

TEST_F(PyramidFile, DamageWhileServingIsRepaired) {
  const BlockId id =
      block_at(4, static_cast<Tick>(101.5 * kTicksPerDegree), static_cast<Tick>(201.5 * kTicksPerDegree));
  const float right = open()->block(id)->vertices[5 * 65 + 5].height_m;
  const auto terrain = open();
  terrain->node(id);  // the chunk is open, its block not yet read
  for (const std::string& file : files()) std::ofstream(file, std::ios::binary) << "gone";
  const auto block = terrain->block(id);
  ASSERT_TRUE(block);
  EXPECT_EQ(block->vertices[block->index(5, 5)].height_m, right);
  EXPECT_GT(terrain->statistics().chunks_rejected, 0U);
}

// Next to a pole the posts that a chunk looks at beyond its border reach over some degrees of longitude.
TEST(Pyramid, NeighbouringTileChangesTheEdgeNextToAPole) {
  const TemporaryFolder folder;
  const auto west_of_8_degrees = [&](const char* cache) {
    const auto terrain = open_terrain(folder / "dem", folder / cache);
    std::vector<float> heights;
    for (const int level : {9, 10, 12}) {
      const auto lat = static_cast<Tick>((90 + 89.62) * kTicksPerDegree),
                 lon = static_cast<Tick>((180 + 7.999) * kTicksPerDegree);
      const auto block = terrain->block(block_at(level, lat, lon));
      for (const Vertex& v : block->vertices) heights.push_back(std::isnan(v.height_m) ? -77777 : v.height_m);
    }
    return heights;
  };
  write_float_tile(folder / "dem", "west", {89.7, 7, 4096, 600, 4096 + 1}, noise);
  const std::vector<float> alone = west_of_8_degrees("cache");
  write_float_tile(folder / "dem", "east", {89.7, 8.1875, 4096, 600, 2048}, [](double, double) { return 5000; });
  const std::vector<float> again = west_of_8_degrees("cache");
  EXPECT_NE(again, alone);
  EXPECT_EQ(again, west_of_8_degrees("new"));
}

TEST_F(PyramidFile, OnlyItsOwnStaleTemporariesAreRemoved) {
  posts(*open());
  const std::string pyramid = fs::path(files().at(0)).parent_path().string();
  const auto put = [](const std::string& path) { std::ofstream(path) << "x"; };
  // A process that is gone: forked, ended and waited for.
  const pid_t gone = ::fork();
  if (gone == 0) ::_exit(0);
  ::waitpid(gone, nullptr, 0);
  const std::string stale = pyramid + "/000001-000002.sgp.tmp-" + std::to_string(gone) + "-0";
  const std::string alive = pyramid + "/000001-000002.sgp.tmp-" + std::to_string(::getppid()) + "-0";
  const std::string foreign = folder_ / "cache/thesis.tmp-final.txt";
  put(stale), put(alive), put(foreign);
  open();
  EXPECT_FALSE(fs::exists(stale));
  EXPECT_TRUE(fs::exists(alive));
  EXPECT_TRUE(fs::exists(foreign)) << "a file of somebody else was deleted";
}

TEST_F(PyramidFile, ReadOnlyCacheStillAnswers) {
  std::ofstream(folder_ / "file") << "no folder";
  const auto terrain = open_terrain(folder_ / "dem", (folder_ / "file") + "/cache");
  EXPECT_FALSE(std::isnan(terrain->height(11, 21).height_m));
  terrain->wait_until_written();
  EXPECT_NE(terrain->cache_trouble().find("memory only"), std::string::npos) << terrain->cache_trouble();
  EXPECT_TRUE(terrain->warnings().empty()) << "no fault of the data";
}

// What the operator was told.
struct Told {
  std::shared_ptr<PyramidTerrain> open(const std::string& dem, const std::string& cache, bool fall_through = false) {
    TerrainOptions options{cache, std::size_t{512} << 20, fall_through, {}, 0};
    options.log = [this](const std::string& text) {
      const std::lock_guard lock(mutex);
      texts.push_back(text);
    };
    return std::make_shared<PyramidTerrain>(Catalogue(std::vector<std::string>{dem}), options);
  }
  std::mutex mutex;
  std::vector<std::string> texts;
};

// A soft limit of this process while it lives.
class Limited {
 public:
  Limited(int resource, rlim_t limit) : resource_(resource) {
    ::getrlimit(static_cast<__rlimit_resource_t>(resource_), &before_);
    const rlimit now{limit, before_.rlim_max};
    EXPECT_EQ(::setrlimit(static_cast<__rlimit_resource_t>(resource_), &now), 0);
  }
  ~Limited() { ::setrlimit(static_cast<__rlimit_resource_t>(resource_), &before_); }

 private:
  int resource_;
  rlimit before_{};
};

// UndefinedBehaviorSanitizer looks at objects through a pipe, and blames them when there is no descriptor for it.
#ifndef __SANITIZE_ADDRESS__
// No descriptor is left.
struct NoDescriptors : Limited {
  NoDescriptors() : Limited(RLIMIT_NOFILE, 3) {}  // 0, 1 and 2 are in use
};

TEST_F(PyramidFile, DescriptorExhaustionDeletesNoPyramid) {
  Told told;
  const auto right = posts(*told.open(folder_ / "dem", folder_ / "cache"));
  const std::vector<std::string> before = files();
  const auto cold = told.open(folder_ / "dem", folder_ / "cache"), warm = told.open(folder_ / "dem", folder_ / "cache");
  warm->node(block_at(4, 101 * kTicksPerDegree, 201 * kTicksPerDegree));  // the file's head is read, its blocks are not
  {
    const NoDescriptors none;
    for (const auto& terrain : {cold, warm}) EXPECT_THROW(terrain->height(11.3, 21.3), SystemFault);
  }
  EXPECT_EQ(files(), before);
  for (const auto& terrain : {cold, warm}) {
    EXPECT_EQ(posts(*terrain), right);
    EXPECT_EQ(terrain->statistics().chunks_built, 0U);
    EXPECT_EQ(terrain->statistics().chunks_rejected, 0U);
  }
  EXPECT_EQ(told.texts, std::vector<std::string>{});
}

TEST_F(PyramidFile, DescriptorExhaustionBlamesNoTile) {
  write_float_tile(folder_ / "dem", "below", {14, 18, 8, 49, 49}, [](double, double) { return 1.0; });
  for (const bool fall_through : {false, true}) {
    const auto terrain = open_terrain(folder_ / "dem", {}, fall_through);
    {
      const NoDescriptors none;
      EXPECT_THROW(terrain->height(11.3, 21.3), SystemFault);
      EXPECT_THROW(Catalogue({folder_ / "dem"}), SystemFault);
    }
    EXPECT_NEAR(terrain->height(11.5, 21.5).height_m, noise(11.5, 21.5), 1e-3);
    EXPECT_TRUE(terrain->warnings().empty());
    EXPECT_FALSE(terrain->has_replacements());
  }
}
#endif

TEST_F(PyramidFile, FullDiskIsReportedOnce) {
  std::signal(SIGXFSZ, SIG_IGN);
  write_kaguya_tile(folder_ / "dem", 12, 60, 2, 32, noise);
  Told told;
  const auto terrain = told.open(folder_ / "dem", folder_ / "cache");
  EXPECT_EQ(terrain->cache_trouble(), "");
  {
    const Limited full(RLIMIT_FSIZE, 1000);
    EXPECT_NEAR(terrain->height(11.5, 21.5).height_m, noise(11.5, 21.5), 1e-3);
    EXPECT_FALSE(std::isnan(terrain->height(11.99, 20.01).height_m));
    terrain->wait_until_written();
  }
  EXPECT_EQ(files(), std::vector<std::string>{});
  ASSERT_EQ(told.texts.size(), 1U);
  EXPECT_EQ(told.texts[0], terrain->cache_trouble());
  EXPECT_NE(told.texts[0].find(folder_ / "cache"), std::string::npos) << told.texts[0];
  EXPECT_EQ(told.texts[0].find(".tmp"), std::string::npos) << told.texts[0];
  EXPECT_GE(terrain->statistics().chunks_built, 1U);
  EXPECT_NEAR(terrain->height(11.5, 61.5).height_m, noise(11.5, 61.5), 1e-3);  // a chunk that was not yet asked for
  terrain->wait_until_written();
  EXPECT_EQ(terrain->cache_trouble(), "");
  EXPECT_EQ(told.texts.size(), 2U);
}

TEST_F(PyramidFile, UnreadableFilesAreKept) {
  if (::geteuid() != 0) GTEST_SKIP() << "needs to be root to become somebody else";
  const auto right = posts(*open());
  const std::vector<std::string> before = files();
  for (const std::string& file : before) fs::permissions(file, fs::perms::none);
  fs::permissions(folder_.path(), fs::perms::all);
  std::vector<fs::file_time_type> times;
  for (const std::string& file : before) times.push_back(fs::last_write_time(file));
  ASSERT_EQ(::seteuid(65534), 0);
  Told told;
  const auto terrain = told.open(folder_ / "dem", folder_ / "cache");
  EXPECT_EQ(posts(*terrain), right);
  EXPECT_NE(terrain->cache_trouble(), "");
  ASSERT_EQ(::seteuid(0), 0);
  EXPECT_EQ(files(), before);
  for (std::size_t i = 0; i < before.size(); ++i) EXPECT_EQ(fs::last_write_time(before[i]), times[i]);
}

TEST_F(PyramidFile, DamageOnDiskIsRepairedAndLogged) {
  const auto right = posts(*open());
  Told told;
  for (const std::string& file : files()) {
    std::fstream f(file, std::ios::in | std::ios::out | std::ios::binary);
    const auto size = fs::file_size(file);  // the head is right, most blocks are not
    f.seekp(static_cast<std::streamoff>(size / 4));
    f << std::string(size - size / 4, '\x7f');
  }
  const std::vector<std::string> damaged = files();
  const auto terrain = told.open(folder_ / "dem", folder_ / "cache");
  EXPECT_EQ(posts(*terrain), right);
  const std::uint64_t deleted = terrain->statistics().chunks_rejected;
  EXPECT_GT(deleted, 0U);
  EXPECT_EQ(told.texts.size(), deleted);
  for (const std::string& text : told.texts) {
    EXPECT_NE(text.find("checksum"), std::string::npos) << text;
    EXPECT_NE(text.find("deleted"), std::string::npos) << text;
    EXPECT_TRUE(std::any_of(damaged.begin(), damaged.end(), [&](const std::string& file) {
      return text.starts_with(file);
    })) << text;
  }
}

}  // namespace
}  // namespace selenograph::dem
