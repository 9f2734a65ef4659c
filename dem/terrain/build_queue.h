// Builds pyramid chunks that are not on disk, one turn of work after the other, on its own thread.
//
// Callers wait for a chunk until their own stop token says otherwise; the build continues to the end of its turn, so
// that a repeated request finds more done each time, and finally everything. Concurrent requests for a chunk share one
// build. Builds without waiting callers are dropped when their turn comes.
//
//   job of a coarse chunk             job of a finer chunk
//   queued --turn--> needs_first --> find_or_add(finer): queued --turns--> done
//      ^                 |                                          |
//      |                 v                                          |
//      +---- queued, awaited = finer job; requeued until done <-----+ work.finer_chunk is set; next turn
#pragma once

#include <tbb/task_arena.h>

#include <atomic>
#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <unordered_map>

#include "dem/base/stop_token.h"
#include "dem/pyramid/chunk.h"

namespace selenograph::dem {

class BuildQueue {
 public:
  // Progress of a chunk's build.
  struct Work {
    ChunkPlan plan;
    Chunk::Finer finer;                        // finer blocks collected so far
    std::optional<ChunkPlan> finer_plan;       // the finer chunk that the last turn requested
    std::shared_ptr<const Chunk> finer_chunk;  // that chunk, once it is built
  };
  // Result of a turn: the chunk, or the finer chunk that it needs first.
  struct Turn {
    std::shared_ptr<const Chunk> chunk;
    std::optional<ChunkPlan> needs_first;
  };
  using TakeTurn = std::function<Turn(Work&, const StopToken&)>;

  // `threads`: size of the builder's arena, 0: all cores. The builder's thread calls take_turn(), whose exceptions are
  // passed to the waiting callers, and on_idle() after a second without work.
  BuildQueue(int threads, TakeTurn take_turn, std::function<void()> on_idle = {});
  ~BuildQueue();  // stops and waits for the turn to end

  // Waits for the chunk. Throws Cancelled when `stop` says so, and after stop().
  std::shared_ptr<const Chunk> get(const ChunkPlan& plan, const StopToken& stop);

  // Cancels builds and all waiting callers: nothing is built from now on. Does not wait.
  void stop();

 private:
  struct Job {
    Work work;
    int waiter_count = 0;          // waiting callers, and jobs of coarser chunks
    std::shared_ptr<Job> awaited;  // the job of work.finer_plan
    bool done = false;
    std::shared_ptr<const Chunk> chunk;
    std::exception_ptr error;
  };

  std::shared_ptr<Job> find_or_add(const ChunkPlan& plan);
  // Loop of the builder's thread.
  void run();
  void advance(const std::shared_ptr<Job>& job, std::unique_lock<std::mutex>& lock);
  void await(const std::shared_ptr<Job>& job, const ChunkPlan& first);
  void finish(Job& job, std::shared_ptr<const Chunk> chunk, std::exception_ptr error);
  static void release_awaited(Job& job);

  const TakeTurn take_turn_;
  const std::function<void()> on_idle_;
  tbb::task_arena arena_;
  std::mutex mutex_;                        // guards jobs and their queue
  std::condition_variable work_available_;  // wakes the builder
  std::condition_variable job_done_;        // wakes callers of get()
  std::unordered_map<BlockId, std::shared_ptr<Job>, BlockIdHash> jobs_;
  std::atomic<bool> stopping_{false};
  std::deque<std::shared_ptr<Job>> queue_;
  std::thread builder_;  // started with the first build
};

}  // namespace selenograph::dem
