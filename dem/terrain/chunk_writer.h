// Writes chunks to the cache folder, one after the other, on its own thread: callers do not wait for a chunk's file,
// and the next chunk is built meanwhile.
//
//   add() --> jobs_: [ being written | pending ]      add() waits while both entries are occupied
//                         |
//                    writer thread: write_() without the lock, then pop_front()
//
// A job stays in jobs_ until its file is complete. So find() has the chunk even if the memory cache evicts it while no
// file can be opened yet.
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

  // Queues a job, after waiting while kMaxJobs are unfinished. Throws std::bad_alloc or std::system_error (no thread):
  // the job is not queued then.
  void add(Job job);
  // Returns a chunk whose file is not complete yet; null if there is none for that node.
  std::shared_ptr<const Chunk> find(const BlockId& node) const;
  void wait_until_done();

 private:
  static constexpr std::size_t kMaxJobs = 2;  // few: unfinished jobs keep their chunks in memory
  void run();

  const std::function<void(const Job&)> write_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;  // jobs_ or stopping_ has changed
  std::deque<Job> jobs_;             // front: being written
  bool stopping_ = false;
  std::thread thread_;  // started with the first job
};

}  // namespace selenograph::dem
