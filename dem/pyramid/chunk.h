// Chunk of the pyramid: all blocks of one quadtree node, from its own level down to the posts, as one file.
//
//     node's level       [ ]                 filtered: heights in the file
//                        [ ][ ]              filtered: heights in the file
//     base_level         [ ][ ][ ][ ]        the posts (direct chunk): bounds in the file, heights in the sources
//
// Level k keeps every 2^k-th position. It is low-pass filtered per octave by the binomial [1 2 1]/4 in both directions,
// so that a coarse mesh is the band-limited surface. Each block stores its lowest and highest height, and the largest
// vertical distance from its surface, by the rendered triangles, to the finest one.
//
// The format is in chunk_format.h. Files are written atomically (temporary name, fsync, rename).
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "dem/base/error.h"
#include "dem/base/stop_token.h"
#include "dem/files/files.h"
#include "dem/grid/block.h"
#include "dem/posts/post_source.h"
#include "dem/pyramid/chunk_format.h"
#include "dem/pyramid/chunk_plan.h"

namespace selenograph::dem {

inline constexpr float kNoHeight_m = std::numeric_limits<float>::quiet_NaN();  // a post without data

// Immutable once opened or built; shared between threads.
class Chunk {
 public:
  using Record = format::Record;

  // Input of a chunk that is not direct: the finer chunks' top blocks (null for an empty one), and the files that these
  // chunks lack. A finer chunk's posts may be farther apart than the top blocks': then its block of posts stands under
  // the ids of all blocks that it covers.
  struct Finer {
    std::unordered_map<BlockId, std::shared_ptr<const Block>, BlockIdHash> blocks;
    std::vector<SourceIndex> replaced;
  };
  // Returns the ids of the blocks that build() needs in Finer::blocks.
  static std::vector<BlockId> finer_blocks(const ChunkPlan& plan);

  // Bytes of a chunk file, and the unusable files that the next coarser layer replaced. A chunk that lacks files must
  // not be cached.
  struct Built {
    std::string bytes;
    std::vector<SourceIndex> replaced;
  };
  // Grids reused from one build to the next: some 120 MB, which the system would otherwise have to clear again.
  class Scratch {
   public:
    PostGridRows take() {
      if (grids_.empty()) return {};
      PostGridRows grid = std::move(grids_.back());
      grids_.pop_back();
      return grid;
    }
    void give(PostGridRows grid) { grids_.push_back(std::move(grid)); }
    void clear() { grids_.clear(); }

   private:
    std::vector<PostGridRows> grids_;
  };

  // Builds a chunk. `finer` is needed for a plan that is not direct; `scratch` may be null. Throws Cancelled when
  // stopped.
  static Built build(const ChunkPlan& plan, const Catalogue& catalogue, const PostSource& source,
                     const Finer& finer = {}, const StopToken& stop = {}, Scratch* scratch = nullptr);

  // Opens a chunk file and reads its index. Returns null when there is no such file. Throws DataError when it is
  // damaged, or does not have the plan's fingerprint; SystemFault when it cannot be read, which says nothing about the
  // file.
  static std::shared_ptr<const Chunk> open(const std::string& path, const ChunkPlan& plan, const Catalogue& catalogue);
  // The same from bytes in memory.
  static std::shared_ptr<const Chunk> from_bytes(std::string bytes, const ChunkPlan& plan, const Catalogue& catalogue,
                                                 std::vector<SourceIndex> replaced = {});

  // Returns the file's content for a chunk in memory; empty for one that is read from its file.
  std::string_view content() const { return bytes_; }

  // Returns a block's index entry; null if the chunk does not hold the block.
  const Record* find(const BlockId& id) const;
  // Reads a block. Returns null when it is empty. Throws DataError naming this chunk (see name()) when its record is
  // damaged, or naming a DEM file when its posts cannot be read; OtherSources when the sources have changed;
  // SystemFault.
  std::shared_ptr<const Block> load(const BlockId& id, const PostSource& source, const StopToken& stop = {}) const;
  // Returns the chunk's path, or a description of one in memory.
  std::string name() const;
  // Thrown when the posts are no longer those from which bounds and coarser levels were made: a file has vanished or
  // changed.
  class OtherSources : public DataError {
    using DataError::DataError;
  };
  // Returns Built::replaced.
  const std::vector<SourceIndex>& replaced() const { return replaced_; }
  // Returns true if the opened file still exists, unchanged, or if the chunk is in memory.
  bool current() const;
  // Returns the chunk's memory, without blocks.
  std::size_t bytes() const;

 private:
  void parse(const std::string& head, const ChunkPlan& plan, const Catalogue& catalogue);
  std::string read(std::uint64_t offset, std::uint64_t size) const;
  std::vector<float> read_stored(const Record& record, Block& block) const;

  BlockId node_;
  std::string path_;  // empty for a chunk in memory
  FileState state_;   // state of the file when it was opened
  std::string bytes_;
  std::vector<SourceIndex> replaced_;
  std::uint64_t total_ = 0;
  double quantisation_m_ = 0;
  int base_level_ = 0;
  std::vector<SourceIndex> catalogue_index_;  // catalogue index by the chunk's own source number
  std::unordered_map<BlockId, Record, BlockIdHash> records_;
};

}  // namespace selenograph::dem
