// Keeps resident memory near the budgets of the caches.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <functional>
#include <mutex>
#include <thread>

namespace selenograph::server {

// Returns the resident memory of this process.
std::size_t resident_bytes();

// Turnover of the caches leaves free pages in the heap, which the allocator keeps, and fragments, which it cannot
// return. Every 50 ms a thread of this object compares the process with the plan:
//  - above max_resident_bytes() or, unless `keep_free`, with more than `slack_bytes` free, the heap returns its free
//    pages to the system;
//  - if that does not suffice, the caches shrink below their budgets by the excess, up to `max_cache_cut_bytes`, and
//    grow back by an eighth of the free space each time.
//
// Measured by tests/service/memory_test.py, 1000 frames of 128 x 128 pixels, 64 MiB each for terrain and scenes, three
// runs: at most 254 MiB resident, without this thread 294. The price is 1.6 to 2.1 times the processor time: smaller
// caches drop 1.3 times as many blocks, and returned pages are taken from the system again. With jemalloc's
// background_thread instead, and a decay of 1 s, at most 293 MiB.
class HeapTrim {
 public:
  struct Plan {
    std::size_t slack_bytes, max_cache_cut_bytes;
    bool keep_free;  // free heap is prepared memory (--pretouch): returned only above the limit, and not counted in it
    std::function<std::size_t()> max_resident_bytes;
    std::function<void(std::size_t bytes)> keep_less;  // makes caches keep `bytes` less than their budget
  };
  // Both functions are called on this object's thread.
  explicit HeapTrim(Plan plan);
  ~HeapTrim();

 private:
  void run();
  void trim();

  const Plan plan_;
  std::size_t cache_cut_bytes_ = 0;
  std::mutex mutex_;
  std::condition_variable stop_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace selenograph::server
