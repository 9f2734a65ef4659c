// Keeps resident memory near the budgets.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <functional>
#include <mutex>
#include <thread>

namespace selenograph::server {

// Resident memory of this process.
std::size_t resident_bytes();

// Turnover of caches leaves free memory in the heap, which keeps it, and holes, which it cannot return. Many times a
// second this returns free memory when the process is larger than `most_bytes` and, unless `keep_free`, when more than
// `slack_bytes` are free. If the process is still too large, caches are told to keep less, up to `most_less_bytes`,
// until it no longer is.
class HeapTrim {
 public:
  struct Plan {
    std::size_t slack_bytes, most_less_bytes;
    bool keep_free;
    std::function<std::size_t()> most_bytes;           // limit of resident memory
    std::function<void(std::size_t bytes)> keep_less;  // makes caches keep `bytes` less than their budget
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
