// The terrain of the posts themselves, from a pyramid over the files of a catalogue.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dem/posts/post_source.h"
#include "dem/support/cache.h"
#include "dem/terrain/terrain.h"

namespace selenograph::dem {

using BlockCache = Cache<BlockId, Block, BlockIdHash>;

class PyramidTerrain final : public Terrain {
 public:
  PyramidTerrain(Catalogue catalogue, const TerrainOptions& options);
  ~PyramidTerrain() override;  // stops building

  const Catalogue& catalogue() const override;
  const Terrain& plain() const override { return *this; }
  const std::vector<BlockId>& roots() const override;
  bool has_data(const BlockId& id) const override;
  int posts_level(const BlockId& id) const override;
  bool node_is_cheap(const BlockId& id) const override;
  NodeInfo node(const BlockId& id, const StopToken& stop = {}) const override;
  std::optional<HeightRange> heights_without_building(const BlockId& id, const StopToken& stop = {}) const override;
  bool waits_for_network(const BlockId& id) const override;
  std::shared_ptr<const Block> block(const BlockId& id, const StopToken& stop = {}) const override;
  bool has_replacements() const override;

  const PostSource& post_source() const;
  // The blocks in memory. Terrains with detail over this one keep theirs here, too, told apart by a number of their
  // own.
  BlockCache& blocks() const;
  int new_detail_number() const;

  // Of its budget so many bytes are needed elsewhere: that much less is kept in memory.
  void keep_less(std::size_t bytes) const;
  // Whoever waits for a build throws Cancelled, and nothing is built any more: the service ends. Returns at once.
  void stop_building() const;
  // Since the terrain was opened, one for each file at fault, in the words of the log.
  std::vector<std::string> warnings() const;
  // Why pyramids are kept in memory only; empty: they are in the cache folder, or there is none.
  std::string cache_trouble() const;
  CacheStatistics statistics() const;

  // Builds the pyramid of everything in the catalogue that is not yet on disk. Calls progress(done, total, name) after
  // each chunk; stops early when it answers false. What is done stays done.
  using Progress = std::function<bool(std::size_t done, std::size_t total, const std::string& name)>;
  void ingest(const Progress& progress) const;
  // Until what has been built is in the cache folder, or can't be.
  void wait_until_written() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::dem
