// Blocks that took long to make, in the cache folder: ground with detail, which every process that flies over it would
// make again. One checksummed file each, written without flushing: what a power failure leaves is noticed, and made
// anew.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>

#include "dem/grid/block.h"
#include "dem/terrain/trouble_log.h"

namespace selenograph::dem {

// Thread-safe. Several processes may use one folder; each keeps to its own count of what is there.
class BlockStore {
 public:
  // `folder` is created with the first file; what an earlier process left there counts. At most `bytes`: the oldest
  // files go first. `trouble` must outlive this object.
  BlockStore(std::string folder, std::size_t bytes, const TroubleLog& trouble);

  // `key`: of all that a block is made from besides its place. Null: it is not there, or not whole, and then removed.
  std::shared_ptr<const Block> read(std::uint64_t key, const BlockId& id);
  // Replaces a file of the same name. After a failure, which the log has, nothing is written any more.
  void write(std::uint64_t key, const Block& block);

  std::size_t bytes() const { return bytes_; }
  std::uint64_t blocks_read() const { return read_; }

 private:
  struct File {
    std::string path;
    std::size_t bytes;
  };
  std::string path_of(std::uint64_t key, const BlockId& id) const;
  void count(std::string path, std::size_t bytes);

  const std::string folder_;
  const std::size_t most_bytes_;
  const TroubleLog& trouble_;
  std::mutex mutex_;
  std::deque<File> files_;  // the oldest first
  std::atomic<std::size_t> bytes_{0};
  std::atomic<std::uint64_t> read_{0};
  std::atomic<bool> broken_{false};
};

}  // namespace selenograph::dem
