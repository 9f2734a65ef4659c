// Ground with detail in the cache folder: what is read is what was made, whatever became of the files.
#include "dem/terrain/block_store.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "dem/base/hash.h"
#include "dem/detail/detailed_terrain.h"
#include "dem/grid/lattice.h"
#include "dem/terrain/surface_place.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::dem {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

constexpr int kLevel = 15;

std::shared_ptr<const Detail> detail(std::uint64_t fingerprint) {
  DetailPreset preset;
  preset.fingerprint = fingerprint;
  preset.craters = {.seed = fingerprint, .largest_m = 64, .smallest_m = 4};
  preset.relief = {.seed = 2, .deviation_m = 0.1, .baseline_m = 10, .longest_m = 32, .shortest_m = 4};
  return std::make_shared<const Detail>(preset);
}

class GroundOnDisk : public ::testing::Test {
 protected:
  GroundOnDisk() {
    test::write_kaguya_tile(tiles_.path(), 27, 3, 1, 256, [](double, double) { return 100.0; });
  }

  // As another process would open it.
  std::shared_ptr<const PyramidTerrain> opened(std::size_t disk_bytes) const {
    TerrainOptions options{cache_.path(), 256UL << 20, false};
    options.ground_disk_bytes = disk_bytes;
    options.log = [this](const std::string& text) { said_.push_back(text); };
    return std::make_shared<PyramidTerrain>(Catalogue(std::vector<std::string>{tiles_.path()}), options);
  }
  static std::vector<BlockId> places(int count) {
    std::vector<BlockId> ids;
    for (int i = 0; i < count; ++i) ids.push_back(block_at_place(kLevel, 26.5 + 0.003 * i, 3.5));
    return ids;
  }
  std::vector<fs::path> files() const {
    std::vector<fs::path> found;
    if (fs::exists(cache_.path() + "/ground"))
      for (const auto& entry : fs::recursive_directory_iterator(cache_.path() + "/ground"))
        if (entry.is_regular_file()) found.push_back(entry.path());
    return found;
  }

  TemporaryFolder tiles_, cache_;
  mutable std::vector<std::string> said_;
};

void expect_same(const Block& a, const Block& b) {
  ASSERT_EQ(a.vertices.size(), b.vertices.size());
  EXPECT_EQ(std::memcmp(a.vertices.data(), b.vertices.data(), a.vertices.size() * sizeof(Vertex)), 0);
  EXPECT_EQ(a.sources, b.sources);
  EXPECT_EQ(a.ground, b.ground);
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(std::tuple(a.error_m, a.detail_error_m, a.left_out_size_m, a.min_m, a.max_m),
            std::tuple(b.error_m, b.detail_error_m, b.left_out_size_m, b.min_m, b.max_m));
  EXPECT_EQ(a.sin_lat, b.sin_lat);
  EXPECT_EQ(a.cos_lon, b.cos_lon);
}

constexpr std::size_t kMuch = 64 << 20;

TEST_F(GroundOnDisk, IsWhatWasMade) {
  const auto ids = places(5);
  const auto without = opened(0);
  const DetailedTerrain made(without, detail(7));
  for (int process = 0; process < 2; ++process) {
    const auto plain = opened(kMuch);
    const DetailedTerrain terrain(plain, detail(7));
    for (const BlockId& id : ids) expect_same(*terrain.block(id), *made.block(id));
    EXPECT_EQ(plain->block_store()->blocks_read(), process == 0 ? 0 : ids.size());
  }
  EXPECT_EQ(files().size(), ids.size());
  // Another detail's ground is another, and one without a name has none there.
  const auto plain = opened(kMuch);
  EXPECT_NE(DetailedTerrain(plain, detail(8)).block(ids[0])->vertices[0].height_m,
            made.block(ids[0])->vertices[0].height_m);
  DetailedTerrain(plain, detail(0)).block(ids[0]);
  EXPECT_EQ(plain->block_store()->blocks_read(), 0U);
  EXPECT_EQ(files().size(), ids.size() + 1);
  EXPECT_EQ(without->block_store(), nullptr);
  EXPECT_TRUE(said_.empty());
}

TEST_F(GroundOnDisk, DamagedFilesAreMadeAnew) {
  const auto id = places(1)[0];
  const auto made = DetailedTerrain(opened(kMuch), detail(7)).block(id);
  const auto damage = [&](const std::function<void(std::string&)>& change) {
    ASSERT_EQ(files().size(), 1U);
    std::ifstream in(files()[0], std::ios::binary);
    std::string bytes{std::istreambuf_iterator<char>(in), {}};
    change(bytes);
    std::ofstream(files()[0], std::ios::binary | std::ios::trunc) << bytes;
    const auto plain = opened(kMuch);
    expect_same(*DetailedTerrain(plain, detail(7)).block(id), *made);
    EXPECT_EQ(plain->block_store()->blocks_read(), 0U);
    const auto again = opened(kMuch);
    expect_same(*DetailedTerrain(again, detail(7)).block(id), *made);
    EXPECT_EQ(again->block_store()->blocks_read(), 1U);
  };
  damage([](std::string& bytes) { bytes[bytes.size() / 2] ^= 1; });
  damage([](std::string& bytes) { bytes.resize(bytes.size() - 1); });
  damage([](std::string& bytes) { bytes += "x"; });
  damage([](std::string& bytes) { bytes.clear(); });
  damage([](std::string& bytes) { bytes.assign(bytes.size(), '\xff'); });
  damage([](std::string& bytes) { bytes[20] ^= 1; });  // the key
}

TEST_F(GroundOnDisk, TakesNoMoreThanItMayInSeveralProcesses) {
  constexpr std::size_t kFew_bytes = 1 << 19;
  const auto on_disk_bytes = [&] {
    std::size_t sum = 0;
    for (const fs::path& file : files()) {
      struct stat s {};
      EXPECT_EQ(::stat(file.c_str(), &s), 0);
      sum += static_cast<std::size_t>(s.st_blocks) * 512;
    }
    return sum;
  };
  // Each opens the store as a process of its own. Their details differ, so they write different files.
  std::vector<std::shared_ptr<const PyramidTerrain>> processes;
  for (int k = 0; k < 3; ++k) processes.push_back(opened(kFew_bytes));
  for (const BlockId& id : places(10))
    for (std::size_t k = 0; k < processes.size(); ++k) {
      DetailedTerrain(processes[k], detail(7 + k)).block(id);
      EXPECT_LE(on_disk_bytes(), kFew_bytes);
    }
  EXPECT_GE(on_disk_bytes(), kFew_bytes / 2);
  EXPECT_TRUE(said_.empty());
  const auto less = opened(kFew_bytes / 2);
  EXPECT_LE(on_disk_bytes(), kFew_bytes / 2);
  EXPECT_GE(files().size(), 1U);
}

TEST_F(GroundOnDisk, AFifoInTheFilesPlaceIsReplaced) {
  const BlockId id = places(1)[0];
  const auto made = DetailedTerrain(opened(kMuch), detail(7)).block(id);
  ASSERT_EQ(files().size(), 1U);
  const fs::path path = files()[0];
  fs::remove(path);
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  expect_same(*DetailedTerrain(opened(kMuch), detail(7)).block(id), *made);
  EXPECT_TRUE(fs::is_regular_file(path));
}

TEST_F(GroundOnDisk, AFolderThatCantBeWrittenIsSaidOnce) {
  std::ofstream(cache_.path() + "/ground") << "a file";
  const DetailedTerrain terrain(opened(kMuch), detail(7));
  for (const BlockId& id : places(3)) EXPECT_NE(terrain.block(id), nullptr);
  ASSERT_EQ(said_.size(), 1U);
  EXPECT_NE(said_[0].find("/ground"), std::string::npos);
}

// If this fails the ground has changed: count kGroundVersion up (detailed_terrain.cpp), and take the new number.
TEST_F(GroundOnDisk, IsOfThisVersion) {
  const auto block = DetailedTerrain(opened(0), detail(7)).block(places(1)[0]);
  std::vector<std::int32_t> millimetres;
  for (const Vertex& v : block->vertices)
    millimetres.push_back(static_cast<std::int32_t>(std::lround(1e3 * static_cast<double>(v.height_m))));
  EXPECT_EQ(dem::hash_of(millimetres.data(), millimetres.size() * sizeof millimetres[0]), 933266982776929061U);
}

}  // namespace
}  // namespace selenograph::dem
