// Loops over all cores of the caller's task arena.
//
// Isolated: a thread that waits here for the loop's end doesn't pick up unrelated work meanwhile, which could be
// another client's frame or could wait for the very thing that this thread is loading.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <cstddef>

#ifdef __SANITIZE_THREAD__
extern "C" {
void __tsan_acquire(void*);
void __tsan_release(void*);
}
#endif

namespace selenograph {
namespace detail {

// Debian's oneTBB is not instrumented: ThreadSanitizer is told here what a loop's start and end order.
inline void hand_over([[maybe_unused]] void* token) {
#ifdef __SANITIZE_THREAD__
  __tsan_release(token);
#endif
}
inline void take_over([[maybe_unused]] void* token) {
#ifdef __SANITIZE_THREAD__
  __tsan_acquire(token);
#endif
}

}  // namespace detail

// body(first, past_last) for pieces of 0 .. count, of at least `grain`.
template <typename Body>
void in_parallel_pieces(std::size_t count, std::size_t grain, const Body& body) {
  char token = 0;
  detail::hand_over(&token);
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, grain),
                      [&](const tbb::blocked_range<std::size_t>& piece) {
                        detail::take_over(&token);
                        body(piece.begin(), piece.end());
                        detail::hand_over(&token);
                      });
  });
  detail::take_over(&token);
}

// body() in the arena, which may hand it to another thread.
template <typename Body>
auto in_arena(tbb::task_arena& arena, const Body& body) {
  char token = 0;
  detail::hand_over(&token);
  auto result = arena.execute([&] {
    detail::take_over(&token);
    auto made = body();
    detail::hand_over(&token);
    return made;
  });
  detail::take_over(&token);
  return result;
}

// body(i) for every i below count.
template <typename Body>
void in_parallel(std::size_t count, const Body& body) {
  in_parallel_pieces(count, 1, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) body(i);
  });
}

}  // namespace selenograph
