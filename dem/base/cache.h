// A single-flight LRU cache with a budget in bytes: of several callers who miss the same key, one loads.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <utility>

#include "dem/base/error.h"
#include "dem/base/stop_token.h"

namespace selenograph::dem {

// Interval at which waiting callers check whether to stop.
inline constexpr std::chrono::milliseconds kLookUp{20};

// Values are shared and immutable; an evicted value lives until its last user releases it. A load that throws is not
// remembered: the next caller tries again. Thread-safe.
template <typename Key, typename Value, typename Hash = std::hash<Key>>
class Cache {
 public:
  using Pointer = std::shared_ptr<const Value>;
  struct Loaded {
    Pointer value;  // may be null: that there is nothing is cached, too
    std::size_t bytes;
  };

  // Memory of values with shared parts: how many bytes a value adds, and how many are freed with it.
  struct Count {
    std::function<std::size_t(const Value&)> add{}, remove{};
  };

  // Without a `count`, a value takes the bytes that its load returns. `recent_bytes`: so much of what was used last
  // stays even where values in use take all of the budget: else what a task needs again and again would be loaded each
  // time.
  explicit Cache(std::size_t capacity_bytes, Count count = {}, std::size_t recent_bytes = 0)
      : capacity_(capacity_bytes), most_recent_bytes_(recent_bytes), count_(std::move(count)) {}

  // Returns the value for `key`, loading it by `load() -> Loaded` if needed. Of concurrent callers, one loads and the
  // others wait, each until its own `stop`: then Cancelled. If the load throws Cancelled, one of the waiting callers
  // loads instead.
  template <typename Load>
  Pointer get(const Key& key, Load&& load, const StopToken& stop = {}) {
    std::shared_ptr<Flight> flight;
    {
      std::unique_lock lock(mutex_);
      for (;;) {
        if (const auto found = entries_.find(key); found != entries_.end()) return used(found);
        const auto flying = flights_.find(key);
        if (flying == flights_.end()) break;
        flight = flying->second;
        while (!flight->done) {
          stop.check();
          landed_.wait_for(lock, kLookUp);
        }
        if (flight->given_up) continue;
        if (flight->error) std::rethrow_exception(flight->error);
        ++hits_;
        return flight->value;
      }
      ++misses_;
      flight = flights_[key] = std::make_shared<Flight>();
    }
    try {
      Loaded loaded = load();
      land(key, *flight, std::move(loaded));
    } catch (const Cancelled&) {
      flight->given_up = true;
      fail(key, *flight, nullptr);
      throw;
    } catch (...) {
      fail(key, *flight, std::current_exception());
      throw;
    }
    return flight->value;
  }

  // Bytes of values in use, which eviction cannot free.
  std::size_t bytes_in_use() const {
    std::lock_guard lock(mutex_);
    std::size_t sum = 0;
    for (const auto& [key, entry] : entries_)
      if (entry.value.use_count() > 1) sum += entry.bytes;
    return std::min(sum, bytes_);
  }

  // Whether a key is cached; does not count as a use.
  bool holds(const Key& key) const {
    std::lock_guard lock(mutex_);
    return entries_.count(key) > 0;
  }

  // The cached value, possibly a null pointer; nullopt if not cached. Counts as a use.
  std::optional<Pointer> find(const Key& key) {
    std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    return found == entries_.end() ? std::nullopt : std::optional(used(found));
  }

  // The cached value, or null. Does not count as a use.
  Pointer peek(const Key& key) const {
    std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    return found == entries_.end() ? nullptr : found->second.value;
  }

  // Replaces a value that is still cached.
  void replace(const Key& key, const Pointer& before, Pointer value, std::size_t bytes) {
    std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    if (found == entries_.end() || found->second.value != before) return;
    bytes_ += bytes - found->second.bytes;
    if (found->second.recent) recent_bytes_ += bytes - found->second.bytes;
    found->second.value = std::move(value), found->second.bytes = bytes;
  }

  void erase(const Key& key) {
    std::lock_guard lock(mutex_);
    if (const auto found = entries_.find(key); found != entries_.end()) drop(found);
  }

  // Reserves bytes that are held elsewhere on the same budget.
  void reserve(std::size_t bytes) {
    std::lock_guard lock(mutex_);
    reserved_ = bytes;
    evict(entries_.size());
  }

  std::size_t bytes() const { return locked(bytes_); }
  std::size_t capacity() const { return capacity_; }
  std::uint64_t hits() const { return locked(hits_); }
  std::uint64_t misses() const { return locked(misses_); }
  std::uint64_t evictions() const { return locked(evictions_); }

 private:
  struct Entry;
  // A map's elements stay where they are.
  using Places = std::list<std::pair<const Key, Entry>*>;
  struct Entry {
    Pointer value;
    std::size_t bytes = 0;
    bool recent = true;
    typename Places::iterator place{};
  };
  struct Flight {
    bool done = false, given_up = false;
    Pointer value;
    std::exception_ptr error;
  };
  using Entries = std::unordered_map<Key, Entry, Hash>;

  template <typename T>
  T locked(const T& value) const {
    std::lock_guard lock(mutex_);
    return value;
  }

  Pointer used(typename Entries::iterator found) {
    ++hits_;
    Entry& entry = found->second;
    recent_.splice(recent_.begin(), entry.recent ? recent_ : older_, entry.place);
    if (!entry.recent) recent_bytes_ += entry.bytes;
    entry.recent = true;
    spill();
    return entry.value;
  }

  // From the recent ones to the older ones.
  void spill() {
    while (recent_bytes_ > most_recent_bytes_) {
      Entry& last = recent_.back()->second;
      older_.splice(older_.begin(), recent_, last.place);
      last.recent = false;
      recent_bytes_ -= last.bytes;
    }
  }

  void land(const Key& key, Flight& flight, Loaded loaded) {
    std::lock_guard lock(mutex_);
    const std::size_t bytes = count_.add && loaded.value ? count_.add(*loaded.value) : loaded.bytes;
    flight.value = loaded.value;
    flight.done = true;
    flights_.erase(key);
    const auto entry = entries_.insert_or_assign(key, Entry{std::move(loaded.value), loaded.bytes}).first;
    recent_.push_front(&*entry);
    entry->second.place = recent_.begin();
    recent_bytes_ += loaded.bytes;
    spill();
    bytes_ += bytes;
    evict(kLooks);
    landed_.notify_all();
  }

  void fail(const Key& key, Flight& flight, const std::exception_ptr& error) {
    std::lock_guard lock(mutex_);
    flight.error = error;
    flight.done = true;
    flights_.erase(key);
    landed_.notify_all();
  }

  // Entries in use are skipped: they stay in memory anyway, and dropping them would only hide them from the budget.
  // They count as used now, so that the next eviction finds others; after so many of them it is left to that.
  void evict(std::size_t looks) {
    while (bytes_ + reserved_ > capacity_ && !older_.empty()) {
      auto& [key, entry] = *older_.back();
      if (entry.value.use_count() <= 1) {
        drop(entries_.find(key));
        ++evictions_;
      } else if (looks-- > 0) {
        older_.splice(older_.begin(), older_, entry.place);
      } else {
        return;
      }
    }
  }

  void drop(typename Entries::iterator found) {
    const Entry& entry = found->second;
    bytes_ -= count_.remove && entry.value ? count_.remove(*entry.value) : entry.bytes;
    if (entry.recent) recent_bytes_ -= entry.bytes;
    (entry.recent ? recent_ : older_).erase(entry.place);
    entries_.erase(found);
  }

  mutable std::mutex mutex_;
  std::condition_variable landed_;
  Entries entries_;
  Places recent_, older_;  // most recently used first
  std::unordered_map<Key, std::shared_ptr<Flight>, Hash> flights_;
  static constexpr std::size_t kLooks = 256;
  std::size_t capacity_, most_recent_bytes_, bytes_ = 0, recent_bytes_ = 0, reserved_ = 0;
  Count count_;
  std::uint64_t hits_ = 0, misses_ = 0, evictions_ = 0;
};

}  // namespace selenograph::dem
