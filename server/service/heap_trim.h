// Keeps resident memory near what the budgets say.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <functional>
#include <mutex>
#include <thread>

namespace selenograph::server {

// Of this process.
std::size_t resident_bytes();

// Caches that turn over leave free memory in the heap, which keeps it, and holes, which it can't give back. Many times
// a second this gives free memory back when the process is larger than `most_bytes` says and, but with `keep_free`,
// when it is more than `slack_bytes`. When the process is still too large, caches are told to keep so much less, up to
// `most_less_bytes`, until it no longer is.
class HeapTrim {
 public:
  struct Plan {
    std::size_t slack_bytes, most_less_bytes;
    bool keep_free;
    std::function<std::size_t()> most_bytes;           // that may be resident now
    std::function<void(std::size_t bytes)> keep_less;  // by so many bytes than the budget
  };
  // Both functions are called on this object's thread.
  explicit HeapTrim(Plan plan);
  ~HeapTrim();

 private:
  void run();
  void look();

  const Plan plan_;
  std::size_t less_ = 0;
  std::mutex mutex_;
  std::condition_variable stop_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace selenograph::server
