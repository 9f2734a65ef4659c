// A piece of the pyramid: all blocks of one quadtree node, from its own level down to the posts, as one file.
//
// Level k keeps every 2^k-th position, low-pass filtered per octave by the binomial [1 2 1]/4 in both directions, so
// that a coarse mesh is the band-limited surface. Each block stores the largest vertical distance from its surface to
// the finest one (by the same triangles that are rendered), and the lowest and highest height. For blocks at the posts'
// own level the file holds only these: their heights are read from the sources.
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

class Chunk {
 public:
  using Record = format::Record;

  // Input of a chunk that is not direct: the finer chunks' top blocks, null where there is nothing, and the files that
  // they lack. Where a finer chunk's posts are farther apart than the top blocks', the block of its posts instead,
  // shared by the ids of all that it covers.
  struct Finer {
    std::unordered_map<BlockId, std::shared_ptr<const Block>, BlockIdHash> blocks;
    std::vector<SourceIndex> replaced;
  };
  // Ids of those blocks, from the plan.
  static std::vector<BlockId> finer_blocks(const ChunkPlan& plan);

  // The bytes of a chunk file, and the unusable files that the next coarser layer replaced. A chunk that lacks files
  // must not be cached.
  struct Built {
    std::string bytes;
    std::vector<SourceIndex> replaced;
  };
  // Grids reused from one build to the next: some 120 MB, which the system would have to clear again.
  class Scratch {
   public:
    PostGridRows take() {
      if (kept_.empty()) return {};
      PostGridRows grid = std::move(kept_.back());
      kept_.pop_back();
      return grid;
    }
    void give(PostGridRows grid) { kept_.push_back(std::move(grid)); }
    void clear() { kept_.clear(); }

   private:
    std::vector<PostGridRows> kept_;
  };

  // `finer`: for a plan that is not direct; `scratch` may be null. Throws Cancelled when stopped.
  static Built build(const ChunkPlan& plan, const Catalogue& catalogue, const PostSource& source,
                     const Finer& finer = {}, const StopToken& stop = {}, Scratch* scratch = nullptr);

  // Null when there is no such file. Throws DataError when it is damaged, or does not have the plan's fingerprint;
  // SystemFault when it cannot be read, which says nothing about the file.
  static std::shared_ptr<const Chunk> open(const std::string& path, const ChunkPlan& plan, const Catalogue& catalogue);
  static std::shared_ptr<const Chunk> from_bytes(std::string bytes, const ChunkPlan& plan, const Catalogue& catalogue,
                                                 std::vector<SourceIndex> replaced = {});

  // The file's content for a chunk in memory; empty for one that is read from its file.
  std::string_view content() const { return bytes_; }

  const Record* find(const BlockId& id) const;
  // Null when the block is empty. Throws DataError naming this chunk (see name()) when its record is damaged, or naming
  // a DEM file when its posts cannot be read; OtherSources when the sources have changed; SystemFault.
  std::shared_ptr<const Block> load(const BlockId& id, const PostSource& source, const StopToken& stop = {}) const;
  // Its path, or a description for one in memory.
  std::string name() const;
  // The posts are no longer those that bounds and coarser levels were made from: a file has vanished or changed.
  class OtherSources : public DataError {
    using DataError::DataError;
  };
  // As in Built.
  const std::vector<SourceIndex>& replaced() const { return replaced_; }
  // Whether the opened file still exists, unchanged.
  bool current() const;
  std::size_t bytes() const;

 private:
  void parse(const std::string& head, const ChunkPlan& plan, const Catalogue& catalogue);
  std::string read(std::uint64_t offset, std::uint64_t size) const;
  std::vector<float> stored(const Record& record, Block& block) const;

  BlockId node_;
  std::string path_;  // empty for a chunk in memory
  FileState state_;   // state of that file
  std::string bytes_;
  std::vector<SourceIndex> replaced_;
  std::uint64_t total_ = 0;
  double quantisation_m_ = 0;
  int base_level_ = 0;
  std::vector<SourceIndex> catalogue_index_;  // by the chunk's own source numbers
  std::unordered_map<BlockId, Record, BlockIdHash> records_;
};

}  // namespace selenograph::dem
