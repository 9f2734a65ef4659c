// Blocks that took long to make, in the cache folder: ground with detail, which every process that flies over it would
// make again. One checksummed file each, written without flushing: what a power failure leaves is noticed, and made
// anew.
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

// Thread-safe. Up to eight processes may use one folder: together they keep within the limit.
class BlockStore {
 public:
  // `folder` is created with the first file. At most `bytes` of disk blocks are used, with what other processes wrote
  // or left there: the oldest files are removed. `trouble` must outlive this object.
  BlockStore(std::string folder, std::size_t bytes, const TroubleLog& trouble);

  // `key`: of all that a block is made from besides its place. Null: it is not there, or not whole, and then removed.
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
  std::mutex scanning_;
  std::atomic<std::size_t> unscanned_bytes_{0};  // written since the last scan
  std::atomic<std::uint64_t> read_{0};
  std::atomic<bool> broken_{false};
};

}  // namespace selenograph::dem
