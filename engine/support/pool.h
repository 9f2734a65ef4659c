// Reusable scratch memory: as much as has ever been in use at once.
#pragma once

#include <algorithm>
#include <memory>
#include <mutex>
#include <new>
#include <thread>
#include <utility>
#include <vector>

namespace selenograph::engine {

// Thread-safe. Take one lease per task, not per pixel: it takes a lock.
template <typename Scratch>
class Pool {
 public:
  class Lease {
   public:
    explicit Lease(Pool& pool) : pool_(pool), scratch_(pool.take_free()) {
      if (!scratch_) scratch_ = std::make_unique<Scratch>();
    }
    ~Lease() { pool_.give(std::move(scratch_)); }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;
    Scratch& operator*() const { return *scratch_; }
    Scratch* operator->() const { return scratch_.get(); }

   private:
    Pool& pool_;
    std::unique_ptr<Scratch> scratch_;
  };

  // Memory that is not lent.
  std::size_t bytes() const {
    std::lock_guard lock(mutex_);
    std::size_t sum = 0;
    for (const Free& one : free_) sum += one.scratch->bytes();
    return sum;
  }
  void clear() {
    std::lock_guard lock(mutex_);
    free_.clear();
  }

 private:
  struct Free {
    std::unique_ptr<Scratch> scratch;
    std::thread::id user;
  };

  // Prefers what this thread had before: it may still be in its caches. Null when nothing is free.
  std::unique_ptr<Scratch> take_free() {
    std::lock_guard lock(mutex_);
    if (free_.empty()) return nullptr;
    auto mine =
        std::find_if(free_.begin(), free_.end(), [](const Free& f) { return f.user == std::this_thread::get_id(); });
    if (mine == free_.end()) --mine;
    std::unique_ptr<Scratch> one = std::move(mine->scratch);
    free_.erase(mine);
    return one;
  }
  // Also called while std::bad_alloc unwinds: an item that the list has no room for is dropped.
  void give(std::unique_ptr<Scratch> one) noexcept {
    std::lock_guard lock(mutex_);
    try {
      free_.push_back({std::move(one), std::this_thread::get_id()});
    } catch (const std::bad_alloc&) {
    }
  }

  mutable std::mutex mutex_;
  std::vector<Free> free_;
};

template <typename T>
std::size_t bytes_of(const std::vector<T>& array) {
  return array.capacity() * sizeof(T);
}

}  // namespace selenograph::engine
