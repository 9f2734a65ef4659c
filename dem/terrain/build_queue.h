// Builds pyramid chunks that are not on disk, one turn of work after the other, on its own thread. Chunks that need
// remote files have a second thread, so that nothing else waits for a slow server.
//
// Callers wait for a chunk until their own stop token says otherwise; the build continues to the end of its turn, so
// that a repeated request finds more done each time, and finally everything. Concurrent requests for a chunk share one
// build. Builds without waiting callers are dropped when their turn comes.
//
//   job of a coarse chunk             job of a finer chunk            (each builder has a queue and a thread)
//   queued --turn--> needs_first --> find_or_add(finer): queued --turns--> done
//      ^                 |                                          |
//      |                 v                                          |
//      +---- queued, awaited = finer job; skipped by can_go_on() <--+ work.finer_chunk is set; next turn
#pragma once

#include <tbb/task_arena.h>

#include <array>
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

// Threads that read posts from a network for one request, or for the builder. Few: when one thread closes a file, GDAL
// forgets it for all, and another thread that is opening it asks the server again, including its folder.
inline constexpr std::size_t kNetworkReaders = 2;

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

  // `threads`: size of the builders' arena, 0: all cores. One builder thread calls take_turn() for local files, another
  // for remote files (ChunkPlan::on_network); its exceptions are passed to the waiting callers. The local builder calls
  // on_idle() after a second without work.
  BuildQueue(int threads, TakeTurn take_turn, std::function<void()> on_idle = {});
  ~BuildQueue();  // stops and waits for the turns to end

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

  struct Builder {
    std::deque<std::shared_ptr<Job>> queue;
    std::thread thread;  // started with the first build
  };
  // Returns whether a job can take a turn: it does not wait for a finer chunk, which the other builder may be building.
  // A job without waiters can, too: its turn drops it.
  static bool can_go_on(const Job& job);

  std::shared_ptr<Job> find_or_add(const ChunkPlan& plan);
  // Loop of a builder's thread.
  void run(bool on_network);
  void advance(const std::shared_ptr<Job>& job, std::unique_lock<std::mutex>& lock);
  void await(const std::shared_ptr<Job>& job, const ChunkPlan& first);
  void finish(Job& job, std::shared_ptr<const Chunk> chunk, std::exception_ptr error);
  void release_awaited(Job& job);

  const TakeTurn take_turn_;
  const std::function<void()> on_idle_;
  tbb::task_arena arena_;
  std::mutex mutex_;                        // guards jobs, builders and their queues
  std::condition_variable work_available_;  // wakes builders
  std::condition_variable job_done_;        // wakes callers of get()
  std::unordered_map<BlockId, std::shared_ptr<Job>, BlockIdHash> jobs_;
  std::atomic<bool> stopping_{false};
  std::array<Builder, 2> builders_;  // [0] for local files, [1] for chunks with remote files
};

}  // namespace selenograph::dem
