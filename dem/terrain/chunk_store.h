// Provides pyramid chunks: from memory, from the cache folder, or built.
//
//   get() --> chunks_ (memory) --miss--> writer_ (file not complete) --none--> file --none, damaged--> builds_
//
// States of a chunk:
//
//   absent --build--> in memory, writer_ has it --written--> in memory from its file <--get() / evict--> file only
//     ^                     |                                       |
//     |                write fails                         reject(): a record is damaged
//     |                     v                                       v
//     |              in memory only                file deleted ------------> absent: built again
//     +--evict--------------+                      file cannot be deleted --> distrusted: built again, in memory only
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_set>

#include "dem/base/cache.h"
#include "dem/posts/post_source.h"
#include "dem/pyramid/chunk.h"
#include "dem/terrain/build_queue.h"
#include "dem/terrain/chunk_plans.h"
#include "dem/terrain/chunk_writer.h"
#include "dem/terrain/terrain.h"
#include "dem/terrain/trouble_log.h"

namespace selenograph::dem {

// Thread-safe.
class ChunkStore {
 public:
  // The arguments must outlive this object. `bytes`: memory for chunks.
  ChunkStore(const Catalogue& catalogue, const PostSource& source, const ChunkPlans& plans, TroubleLog& trouble,
             const TerrainOptions& options, std::size_t bytes);

  // Removes unfinished files from the cache folder. Call it once, before any other member.
  void open_folder();

  // Returns a chunk; waits for its build if necessary. Throws as Terrain does.
  std::shared_ptr<const Chunk> get(const ChunkPlan& plan, const StopToken& stop);
  // Loads a block from its chunk.
  std::shared_ptr<const Block> load(const BlockId& id, const ChunkPlan& plan, const StopToken& stop);
  // Returns whether the chunk is in memory or in the cache folder.
  bool has(const ChunkPlan& plan) const;

  // Waiting callers throw Cancelled, and nothing is built any more. Returns at once.
  void stop_building() { builds_.stop(); }
  void wait_until_written() { writer_.wait_until_done(); }

  // Returns the file name and the reason of the first built chunk that could not be stored in the cache folder; empty
  // if there is none. Chunks with replacements, which are never stored, do not count.
  std::string unwritten() const;

  // Returns whether any chunk was built without a file that is unusable.
  bool has_replacements() const { return replacements_; }
  // Statistics of chunks only, without hits and misses.
  CacheStatistics statistics() const;

 private:
  std::string path_of(const ChunkPlan& plan) const;
  // Returns the chunk from the writer or from the cache folder; null: it has to be built.
  std::shared_ptr<const Chunk> stored_chunk(const ChunkPlan& plan);
  // Body of a builder's turn: returns the built chunk, or the finer chunk that it needs first.
  BuildQueue::Turn take_turn(BuildQueue::Work& work, const StopToken& stop);
  std::optional<ChunkPlan> collect_finer(BuildQueue::Work& work, const StopToken& stop);
  bool collect_block(BuildQueue::Work& work, const ChunkPlan& from, const BlockId& id, const StopToken& stop);
  std::shared_ptr<const Chunk> build(const ChunkPlan& plan, const Chunk::Finer& finer, const StopToken& stop);
  void write(const ChunkWriter::Job& job);
  void note_unwritten(const std::string& why);
  void reject(const ChunkPlan& plan, const Chunk& opened, const DataError& why);
  void distrust(const BlockId& node);
  bool is_distrusted(const BlockId& node) const;

  const Catalogue& catalogue_;
  const PostSource& source_;
  const ChunkPlans& plans_;
  TroubleLog& trouble_;
  const std::string cache_dir_;
  Cache<BlockId, Chunk, BlockIdHash> chunks_;
  std::atomic<std::uint64_t> chunks_built_{0}, chunks_read_{0}, chunks_rejected_{0};
  std::atomic<bool> replacements_{false};
  mutable std::mutex mutex_;
  // Nodes whose file is damaged and cannot be removed, or may not be read.
  std::unordered_set<BlockId, BlockIdHash> distrusted_;
  std::string unwritten_;   // see unwritten()
  Chunk::Scratch scratch_;  // memory that builds from local files reuse; used by their thread only
  ChunkWriter writer_;
  BuildQueue builds_;  // declared last: its thread uses all of the above
};

}  // namespace selenograph::dem
