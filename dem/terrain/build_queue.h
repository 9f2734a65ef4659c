// Pyramid chunks that are not on the disk are built here, one turn of work after the other, on a thread of their own.
// What needs files on a network has another such thread, so that nothing else waits for a slow server.
//
// Whoever needs a chunk waits for it until its own stop token says otherwise; the build goes on without it to the end
// of its turn, so that the same request, asked again, finds a little more done each time and in the end all of it. Of
// several who need the same chunk one build serves all. What nobody waits for any more when its turn comes is dropped.
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

#include "dem/pyramid/chunk.h"
#include "dem/support/stop_token.h"

namespace selenograph::dem {

// Threads that read posts from a network for one request, or for the builder. Few: when one thread closes a file, GDAL
// forgets it for all, and another that is opening it asks the server again, for its folder, too.
inline constexpr std::size_t kNetworkReaders = 2;

class BuildQueue {
 public:
  // A chunk on its way, as far as its builder sees it.
  struct Work {
    ChunkPlan plan;
    Chunk::Finer finer;                  // collected so far
    std::optional<ChunkPlan> asked_for;  // the finer chunk that the last turn asked for,
    std::shared_ptr<const Chunk> made;   // which is this
  };
  // What a turn came to: the chunk, or the finer one without which it can't go on.
  struct Turn {
    std::shared_ptr<const Chunk> chunk;
    std::optional<ChunkPlan> needs_first;
  };
  using TakeTurn = std::function<Turn(Work&, const StopToken&)>;

  // `threads` that build, 0: all cores. take_turn() is called by one thread at a time for what is on this machine, and
  // by one for what is on a network (ChunkPlan::on_network); what it throws is what those who wait get. The first of
  // them calls rest() when it had nothing to build for a second.
  BuildQueue(int threads, TakeTurn take_turn, std::function<void()> rest = {});
  ~BuildQueue();  // stops and waits for the turns to end

  // Waits for the chunk. Throws Cancelled when `stop` says so, and after stop().
  std::shared_ptr<const Chunk> get(const ChunkPlan& plan, const StopToken& stop);

  // Gives up what is being built, and everybody who waits: from now on nothing is built. Does not wait.
  void stop();

 private:
  struct Job {
    Work work;
    int wanted = 0;                // by those who wait, and by coarser chunks
    std::shared_ptr<Job> awaited;  // the job of work.asked_for
    bool done = false;
    std::shared_ptr<const Chunk> chunk;
    std::exception_ptr error;
  };

  struct Builder {
    std::deque<std::shared_ptr<Job>> queue;
    std::thread thread;  // from its first build on
  };
  static bool can_go_on(const Job& job);

  std::shared_ptr<Job> find_or_add(const ChunkPlan& plan);
  void run(bool on_network);
  void advance(const std::shared_ptr<Job>& job, std::unique_lock<std::mutex>& lock);
  void await(const std::shared_ptr<Job>& job, const ChunkPlan& first);
  void finish(Job& job, std::shared_ptr<const Chunk> chunk, std::exception_ptr error);
  void let_go(Job& job);

  const TakeTurn take_turn_;
  const std::function<void()> rest_;
  tbb::task_arena arena_;
  std::mutex mutex_;
  std::condition_variable added_, landed_;
  std::unordered_map<BlockId, std::shared_ptr<Job>, BlockIdHash> jobs_;
  std::atomic<bool> stopping_{false};
  std::array<Builder, 2> builders_;  // of what is on this machine, and on a network
};

}  // namespace selenograph::dem
