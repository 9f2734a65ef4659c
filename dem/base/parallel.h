// Loops over all cores of the caller's task arena (in_arena).
//
//   caller --in_arena(arena)--> body --in_parallel--> [ slot | slot | slot ]  TBB workers and callers that execute()
//
// Loops are isolated: a thread that waits for the end of a loop does not start unrelated work meanwhile. Such work
// could be another client's frame, or could wait for the data that this very thread is loading: a deadlock.
//
// Under ThreadSanitizer the loops run on plain threads. Debian's oneTBB is not instrumented: with it every hand-over
// between tasks looks like a race, and suppressing those would hide the races of the loops' bodies with them.
#pragma once

#include <tbb/task_arena.h>

#include <atomic>
#include <cstddef>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

namespace selenograph {

// Refers to a callable, which must outlive it. Loops take their bodies so: a template would compile oneTBB's loop for
// each of them.
template <typename... Arguments>
class BodyRef {
 public:
  template <typename Body>
  BodyRef(const Body& body)  // NOLINT(google-explicit-constructor): a body is what callers pass
      : body_(&body),
        call_([](const void* of, Arguments... arguments) { (*static_cast<const Body*>(of))(arguments...); }) {}
  void operator()(Arguments... arguments) const { call_(body_, arguments...); }

 private:
  const void* body_;
  void (*call_)(const void*, Arguments...);
};

// Arena of the calling thread's loops; null: the arena that it is in.
inline thread_local tbb::task_arena* arena_of_loops = nullptr;

// Sets arena_of_loops during its lifetime.
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

// Calls body() with its loops in the arena; each loop enters it by itself, not the whole body. An arena reserves one
// slot for callers. A second caller in the arena takes a worker's slot, and the arena lacks that worker meanwhile.
template <typename Body>
auto in_arena(tbb::task_arena& arena, const Body& body) {
  const ArenaOfLoops loops(&arena);
  return body();
}

// Calls body() as a loop would run: in the caller's arena, isolated, possibly on another thread. For libraries that
// have loops of their own, and for work that must own a slot before it starts.
void where_loops_run(BodyRef<> body);

// Calls body(first, past_last) for pieces of 0 .. count of at least `grain`. Returns when all pieces are done, or
// throws an exception of one of them.
void in_parallel_pieces(std::size_t count, std::size_t grain, BodyRef<std::size_t, std::size_t> body);

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
  std::vector<T> gathered;
  std::mutex mutex;
  in_parallel_pieces(count, grain, [&](std::size_t first, std::size_t past_last) {
    std::vector<T> piece;
    for (std::size_t i = first; i < past_last; ++i) make(i, piece);
    const std::lock_guard lock(mutex);
    gathered.insert(gathered.end(), piece.begin(), piece.end());
  });
  return gathered;
}

// Collects likewise, but returns empty if there are more than `max_count` results. Stops soon after exceeding it, so
// that hardly more results are ever in memory.
template <typename T, typename Make>
std::optional<std::vector<T>> gathered_in_parallel(std::size_t count, std::size_t grain, std::size_t max_count,
                                                   const Make& make) {
  std::atomic<std::size_t> number{0};
  auto gathered = gathered_in_parallel<T>(count, grain, [&](std::size_t i, std::vector<T>& piece) {
    if (number > max_count) return;
    const std::size_t before = piece.size();
    make(i, piece);
    number += piece.size() - before;
  });
  return number > max_count ? std::nullopt : std::optional(std::move(gathered));
}

}  // namespace selenograph
