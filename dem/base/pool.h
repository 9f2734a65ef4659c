// Reusable scratch memory: the pool holds as many items as were ever in use at once.
#pragma once

#include <algorithm>
#include <memory>
#include <mutex>
#include <new>
#include <thread>
#include <utility>
#include <vector>

namespace selenograph {

// Pool of scratch items. Thread-safe. Take one lease per task, not per pixel, because a lease locks a mutex.
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

  // Returns the memory of the items that are not leased.
  std::size_t bytes() const {
    std::lock_guard lock(mutex_);
    std::size_t sum = 0;
    for (const Free& item : free_) sum += item.scratch->bytes();
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

  // Takes a free item, preferably the one that this thread used before, which may still be in its processor's caches.
  // Null if none is free.
  std::unique_ptr<Scratch> take_free() {
    std::lock_guard lock(mutex_);
    if (free_.empty()) return nullptr;
    auto own =
        std::find_if(free_.begin(), free_.end(), [](const Free& f) { return f.user == std::this_thread::get_id(); });
    if (own == free_.end()) --own;
    std::unique_ptr<Scratch> item = std::move(own->scratch);
    free_.erase(own);
    return item;
  }
  // Returns an item to the pool. Also called while std::bad_alloc unwinds: an item is dropped if the list cannot grow.
  void give(std::unique_ptr<Scratch> item) noexcept {
    std::lock_guard lock(mutex_);
    try {
      free_.push_back({std::move(item), std::this_thread::get_id()});
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

}  // namespace selenograph
