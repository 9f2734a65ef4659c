// The terrain of the posts, from a pyramid over the files of a catalogue.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/base/cache.h"
#include "dem/posts/post_source.h"
#include "dem/terrain/terrain.h"

namespace selenograph::dem {

using BlockCache = Cache<BlockId, Block, BlockIdHash>;

class BlockStore;

class PyramidTerrain final : public Terrain {
 public:
  PyramidTerrain(Catalogue catalogue, const TerrainOptions& options);
  ~PyramidTerrain() override;  // stops building

  const Catalogue& catalogue() const override;
  const PyramidTerrain& plain() const override { return *this; }
  const std::vector<BlockId>& roots() const override;
  bool has_data(const BlockId& id) const override;
  int posts_level(const BlockId& id) const override;
  NodeInfo node(const BlockId& id, const StopToken& stop = {}) const override;
  std::shared_ptr<const Block> block(const BlockId& id, const StopToken& stop = {}) const override;

  // As the functions of dem/detail/unloaded_blocks.h, for terrain with and without detail.
  bool node_is_cheap(const BlockId& id) const;
  std::optional<HeightRange> heights_without_building(const BlockId& id, const StopToken& stop = {}) const;
  // Returns whether any NodeInfo::replaced may be non-empty.
  bool has_replacements() const;

  const PostSource& post_source() const;
  // The cache of blocks. Terrains with detail over this one share it; their blocks have a number of their own.
  BlockCache& blocks() const;
  int new_detail_number() const;
  // The store of blocks with detail in the cache folder; null: none.
  BlockStore* block_store() const;

  // Ends all builds, because the service is shutting down: waiting callers throw Cancelled. Returns at once.
  void stop_building() const;
  // Returns the warnings since the terrain was opened, one per faulty file, as in the log.
  std::vector<std::string> warnings() const;
  // Returns the reason why pyramids are in memory only; empty: they are in the cache folder, or there is none.
  std::string cache_trouble() const;
  CacheStatistics statistics() const;

  // Builds the pyramid of everything in the catalogue that is not yet on disk. Calls progress(done, total, name) after
  // each chunk; stops when it returns false. Finished chunks stay. Throws std::runtime_error with the file and the
  // reason as soon as a chunk cannot be written: the remaining ones would be built for nothing.
  using Progress = std::function<bool(std::size_t done, std::size_t total, const std::string& name)>;
  void ingest(const Progress& progress) const;
  // Waits until all built chunks have been written to the cache folder, or have failed.
  void wait_until_written() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::dem
