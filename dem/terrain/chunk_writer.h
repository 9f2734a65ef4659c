// Writes chunks to the cache folder, one after the other, on a thread of its own: who waits for a chunk doesn't wait
// for its file, and the next one is built meanwhile.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>

#include "dem/pyramid/chunk.h"

namespace selenograph::dem {

class ChunkWriter {
 public:
  struct Job {
    ChunkPlan plan;
    std::shared_ptr<const Chunk> chunk;
  };
  // `write` is called by one thread at a time and does not throw.
  explicit ChunkWriter(std::function<void(const Job&)> write);
  ~ChunkWriter();  // writes what is left

  // Waits while there are kMost already. Throws std::bad_alloc, std::system_error (no thread): nothing is written then.
  void add(Job job);
  // Null: nothing of that node is on its way.
  std::shared_ptr<const Chunk> find(const BlockId& node) const;
  void wait_until_done();

 private:
  static constexpr std::size_t kMost = 2;  // they are in memory until they are written
  void run();

  const std::function<void(const Job&)> write_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> jobs_;  // the first is being written
  bool stopping_ = false;
  std::thread thread_;  // from the first job on
};

}  // namespace selenograph::dem
