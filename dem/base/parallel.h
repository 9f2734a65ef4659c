// Loops over all cores of the caller's task arena (in_arena), or on their own threads (on_own_threads).
//
// Loops are isolated: a thread that waits for the end of a loop does not start unrelated work meanwhile, which could be
// another client's frame or wait for the data that this thread is loading.
//
// Under ThreadSanitizer the loops run on plain threads. Debian's oneTBB is not instrumented: with it every hand-over
// between tasks looks like a race, and suppressing those would hide the races of the loops' bodies with them.
#pragma once

#ifndef __SANITIZE_THREAD__
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_group.h>
#endif
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

namespace selenograph {

#ifdef __SANITIZE_THREAD__
inline constexpr std::size_t kThreadsWithin = 4;  // threads of a nested loop
inline thread_local std::size_t threads_of_loops = 4;
#else
inline constexpr std::size_t kThreadsWithin = 1;
// Number of own threads of this thread's loops; 0: they run in an arena.
inline thread_local std::size_t threads_of_loops = 0;
#endif

class ThreadsOfLoops {
 public:
  explicit ThreadsOfLoops(std::size_t threads) : before_(std::exchange(threads_of_loops, threads)) {}
  ~ThreadsOfLoops() { threads_of_loops = before_; }
  ThreadsOfLoops(const ThreadsOfLoops&) = delete;
  ThreadsOfLoops& operator=(const ThreadsOfLoops&) = delete;

 private:
  std::size_t before_;
};

// Maximum number of concurrent reads from a network.
inline constexpr std::size_t kConnections = 16;

// Calls body() with its loops on their own threads: for work that waits for a network. Meanwhile it occupies no place
// in an arena and none of its threads, which other loops need. Nested loops have one thread.
template <typename Body>
auto on_own_threads(std::size_t threads, const Body& body) {
  const ThreadsOfLoops own(threads_of_loops > 0 ? threads_of_loops : threads);
  return body();
}

template <typename Body>
void pieces_on_threads(std::size_t threads, std::size_t count, std::size_t grain, const Body& body) {
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr thrown;
  const auto work = [&] {
    const ThreadsOfLoops within(kThreadsWithin);
    try {
      // Relaxed: pieces of one loop must not order each other.
      for (std::size_t first; (first = next.fetch_add(grain, std::memory_order_relaxed)) < count;)
        body(first, std::min(first + grain, count));
    } catch (...) {
      const std::lock_guard lock(mutex);
      thrown = std::current_exception();
      next.store(count, std::memory_order_relaxed);
    }
  };
  std::vector<std::thread> helpers;
  helpers.reserve(threads);
  try {
    for (std::size_t i = 1; i < std::min(threads, (count + grain - 1) / grain); ++i) helpers.emplace_back(work);
  } catch (const std::exception&) {
    // The system has no more threads or memory: the existing ones do all the work.
  }
  work();
  for (std::thread& helper : helpers) helper.join();
  if (thrown) std::rethrow_exception(thrown);
}

#ifdef __SANITIZE_THREAD__
template <typename Body>
void in_parallel_pieces(std::size_t count, std::size_t grain, const Body& body) {
  pieces_on_threads(threads_of_loops, count, grain, body);
}

template <typename Body>
auto in_arena(tbb::task_arena&, const Body& body) {
  return body();
}

template <typename Body>
void where_loops_run(const Body& body) {
  body();
}
#else
// Arena of this thread's loops; null: the current one.
inline thread_local tbb::task_arena* arena_of_loops = nullptr;

class ArenaOfLoops {
 public:
  explicit ArenaOfLoops(tbb::task_arena* arena) : before_(std::exchange(arena_of_loops, arena)) {}
  ~ArenaOfLoops() { arena_of_loops = before_; }
  ArenaOfLoops(const ArenaOfLoops&) = delete;
  ArenaOfLoops& operator=(const ArenaOfLoops&) = delete;
  tbb::task_arena* before() const { return before_; }

 private:
  tbb::task_arena* before_;
};

// Calls body() with its loops in the arena. They enter it one by one: an arena has one place reserved for callers;
// another caller would take a worker's place, and the arena would lack that worker meanwhile.
template <typename Body>
auto in_arena(tbb::task_arena& arena, const Body& body) {
  const ArenaOfLoops loops(&arena);
  return body();
}

// Calls body() as one loop, possibly on another thread: for libraries that have their own loops.
template <typename Body>
void where_loops_run(const Body& body) {
  if (threads_of_loops > 0) return body();
  const ArenaOfLoops here(nullptr);
  const auto alone = [&] { tbb::this_task_arena::isolate(body); };
  if (here.before())
    here.before()->execute(alone);
  else
    alone();
}

// Calls body(first, past_last) for pieces of 0 .. count of at least `grain`. Returns when all are done, or throws one
// of their exceptions. The loop has its own context: with a shared one, oneTBB would skip pieces of a nested loop in a
// body that has thrown, and return as if they were done.
template <typename Body>
void in_parallel_pieces(std::size_t count, std::size_t grain, const Body& body) {
  if (threads_of_loops > 0) return pieces_on_threads(threads_of_loops, count, grain, body);
  where_loops_run([&] {
    tbb::task_group_context whole(tbb::task_group_context::isolated);
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, count, grain),
        [&](const tbb::blocked_range<std::size_t>& piece) { body(piece.begin(), piece.end()); }, whole);
  });
}
#endif

// Calls body(i) for every i below count.
template <typename Body>
void in_parallel(std::size_t count, const Body& body) {
  in_parallel_pieces(count, 1, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) body(i);
  });
}

// Collects what make(i, list) appends for every i below count, in pieces of at least `grain`, in no particular order.
template <typename T, typename Make>
std::vector<T> gathered_in_parallel(std::size_t count, std::size_t grain, const Make& make) {
  std::vector<T> all;
  std::mutex mutex;
  in_parallel_pieces(count, grain, [&](std::size_t first, std::size_t past_last) {
    std::vector<T> some;
    for (std::size_t i = first; i < past_last; ++i) make(i, some);
    const std::lock_guard lock(mutex);
    all.insert(all.end(), some.begin(), some.end());
  });
  return all;
}

// The same, but empty if there are more than `most`; hardly more than that are ever held.
template <typename T, typename Make>
std::optional<std::vector<T>> gathered_in_parallel(std::size_t count, std::size_t grain, std::size_t most,
                                                   const Make& make) {
  std::atomic<std::size_t> number{0};
  auto all = gathered_in_parallel<T>(count, grain, [&](std::size_t i, std::vector<T>& some) {
    if (number > most) return;
    const std::size_t before = some.size();
    make(i, some);
    number += some.size() - before;
  });
  return number > most ? std::nullopt : std::optional(std::move(all));
}

}  // namespace selenograph
