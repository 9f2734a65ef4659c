// Stores blocks with detail in the cache folder, because every process that flies over the ground would otherwise make
// them again. One checksummed file per block, written without flushing to disk: a file that a power failure damaged
// fails its checksum, and the block is made again.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>

#include "dem/grid/block.h"
#include "dem/terrain/trouble_log.h"

namespace selenograph::dem {

// Thread-safe. Up to eight processes may use one folder; together they stay within the limit.
class BlockStore {
 public:
  // The first file creates `folder`. All files in it, those of other processes too, use at most `bytes` of disk blocks:
  // the oldest files are removed. `trouble` must outlive this object.
  BlockStore(std::string folder, std::size_t bytes, const TroubleLog& trouble);

  // Returns a block, or null if its file is missing or damaged; a damaged file is removed. `key`: hash of everything
  // from which a block is made, besides its id.
  std::shared_ptr<const Block> read(std::uint64_t key, const BlockId& id);
  // Replaces a file of the same name. Skips the block while another thread removes old files. After a failure, which
  // is logged, nothing is written any more.
  void write(std::uint64_t key, const Block& block);

  std::uint64_t blocks_read() const { return read_; }

 private:
  std::string path_of(std::uint64_t key, const BlockId& id) const;
  bool make_space(std::size_t bytes);
  void remove_oldest();

  const std::string folder_;
  const std::size_t max_bytes_;
  const TroubleLog& trouble_;
  std::mutex scanning_;                          // held by the thread that removes old files
  std::atomic<std::size_t> unscanned_bytes_{0};  // bytes written since the last scan
  std::atomic<std::uint64_t> read_{0};
  std::atomic<bool> broken_{false};  // a write has failed: write no more
};

}  // namespace selenograph::dem
