// Writes chunks to the cache folder, one after the other, on its own thread: callers do not wait for a chunk's file,
// and the next chunk is built meanwhile.
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
  ~ChunkWriter();  // writes the remaining jobs

  // Waits while kMost jobs are pending. Throws std::bad_alloc or std::system_error (no thread): nothing is written
  // then.
  void add(Job job);
  // A pending chunk; null if there is none for that node.
  std::shared_ptr<const Chunk> find(const BlockId& node) const;
  void wait_until_done();

 private:
  static constexpr std::size_t kMost = 2;  // pending chunks stay in memory
  void run();

  const std::function<void(const Job&)> write_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> jobs_;  // the first one is being written
  bool stopping_ = false;
  std::thread thread_;  // started with the first job
};

}  // namespace selenograph::dem
