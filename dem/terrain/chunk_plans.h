// Maps blocks of a catalogue's pyramid to the chunks that hold them, and chunks to the files that they depend on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <unordered_map>
#include <vector>

#include "dem/base/hash.h"
#include "dem/catalogue/catalogue.h"
#include "dem/grid/lattice.h"
#include "dem/posts/post_source.h"
#include "dem/pyramid/chunk_plan.h"

namespace selenograph::dem {

// Thread-safe.
class ChunkPlans {
 public:
  // Both must outlive this object. `fall_through` as in TerrainOptions.
  ChunkPlans(const Catalogue& catalogue, const PostSource& source, bool fall_through);

  // Returns the chunk that holds a block; for a block finer than the posts, the one that holds its finest ancestor.
  ChunkPlan plan_for(const BlockId& id) const;
  // Returns whether a source is near a block.
  bool has_data(const BlockId& id) const;
  // Returns the finest level of the posts in a block.
  int posts_level(const BlockId& id) const;

  // The blocks of level 0 that have data.
  const std::vector<BlockId>& roots() const { return roots_; }
  // Returns all chunks, each after the finer ones from which it is built.
  std::vector<ChunkPlan> all_plans() const;

 private:
  ChunkPlan plan(const ChunkNode& chunk) const;
  ChunkPlan make_plan(const ChunkNode& chunk) const;
  std::uint64_t fingerprint_of(const ChunkPlan& plan) const;
  std::vector<int> files_around(const ChunkPlan& plan, double margin) const;  // margin in degrees of latitude
  void add_with_finer(const BlockId& id, std::vector<ChunkPlan>& found) const;

  void add_joins(const ChunkPlan& plan, StreamedHash& fingerprint) const;
  void add_borders(const ChunkPlan& plan, StreamedHash& fingerprint) const;

  const Catalogue& catalogue_;
  const PostSource& source_;
  bool fall_through_;
  std::vector<BlockId> roots_;
  mutable std::mutex mutex_;
  mutable std::unordered_map<BlockId, ChunkPlan, BlockIdHash> plans_;
};

}  // namespace selenograph::dem
