// Keeps resident memory near what the budgets say.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <functional>
#include <mutex>
#include <thread>

namespace selenograph::server {

// Caches that turn over leave holes in the heap, which glibc keeps: twice the budget after a few hundred frames. Once a
// second this compares resident memory with what is held, and gives the holes back when they exceed `slack_bytes`.
// Where budgets are ample that never happens; otherwise it costs some milliseconds of one thread.
class HeapTrim {
 public:
  // `held_bytes` answers what caches hold now; called on this object's thread.
  HeapTrim(std::function<std::size_t()> held_bytes, std::size_t slack_bytes);
  ~HeapTrim();

 private:
  void run();

  const std::function<std::size_t()> held_bytes_;
  const std::size_t slack_bytes_, start_bytes_;
  std::mutex mutex_;
  std::condition_variable stop_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace selenograph::server
