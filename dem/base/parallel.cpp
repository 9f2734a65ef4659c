#include "dem/base/parallel.h"

#ifdef __SANITIZE_THREAD__
#include <algorithm>
#include <exception>
#include <thread>
#else
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_group.h>
#endif

namespace selenograph {

#ifdef __SANITIZE_THREAD__
void where_loops_run(BodyRef<> body) { body(); }

// Runs the pieces on the calling thread and three others. Rethrows an exception of a body after all threads have ended;
// the remaining pieces are then skipped.
void in_parallel_pieces(std::size_t count, std::size_t grain, BodyRef<std::size_t, std::size_t> body) {
  constexpr std::size_t kThreads = 4;
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr thrown;
  const auto work = [&] {
    try {
      // Take the next piece with relaxed order: the pieces of a loop are independent of each other.
      for (std::size_t first; (first = next.fetch_add(grain, std::memory_order_relaxed)) < count;)
        body(first, std::min(first + grain, count));
    } catch (...) {
      const std::lock_guard lock(mutex);
      thrown = std::current_exception();
      next.store(count, std::memory_order_relaxed);
    }
  };
  std::vector<std::thread> helpers;
  helpers.reserve(kThreads);
  try {
    for (std::size_t i = 1; i < std::min(kThreads, (count + grain - 1) / grain); ++i) helpers.emplace_back(work);
  } catch (const std::exception&) {
    // The system has no more threads or memory: the threads started so far do all the work.
  }
  work();
  for (std::thread& helper : helpers) helper.join();
  if (thrown) std::rethrow_exception(thrown);
}
#else
void where_loops_run(BodyRef<> body) {
  const ArenaOfLoops current(nullptr);
  const auto isolated = [&] { tbb::this_task_arena::isolate(body); };
  if (current.before())
    current.before()->execute(isolated);
  else
    isolated();
}

// The loop has its own context: with a shared one, oneTBB would skip pieces of a nested loop in a body that has thrown,
// and return as if they were done.
void in_parallel_pieces(std::size_t count, std::size_t grain, BodyRef<std::size_t, std::size_t> body) {
  where_loops_run([&] {
    tbb::task_group_context context(tbb::task_group_context::isolated);
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, count, grain),
        [&](const tbb::blocked_range<std::size_t>& piece) { body(piece.begin(), piece.end()); }, context);
  });
}
#endif

}  // namespace selenograph
