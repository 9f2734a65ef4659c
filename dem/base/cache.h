// A single-flight LRU cache with a budget in bytes: if several callers miss the same key, one loads it.
//
//   get(key): entry? --yes--> return      flight of another caller? --yes--> sleep until it lands, or until `stop`
//                | no                                   | no
//                +--------------------------------------+--> start a flight, load() without the lock, land: new entry
//
//   LRU lists:   recent_ (newest ... oldest) --spill, above recent_bytes--> older_ (newest ... oldest) --> evicted
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
inline constexpr std::chrono::milliseconds kPollInterval{20};

// Values are shared and immutable; an evicted value lives until its last user releases it. A load that throws is not
// remembered: the next caller tries again. Thread-safe.
template <typename Key, typename Value, typename Hash = std::hash<Key>>
class Cache {
 public:
  using Pointer = std::shared_ptr<const Value>;
  struct Loaded {
    Pointer value;  // may be null: the absence of a value is cached, too
    std::size_t bytes;
  };

  // Memory of values that share data: the bytes that a value adds to the cache, and those that its removal frees.
  struct Count {
    std::function<std::size_t(const Value&)> add{}, remove{};
  };

  // Without a `count`, a value takes the bytes that its load returns. `recent_bytes`: bytes of the latest entries that
  // eviction spares even if values in use fill the budget. Without it a task would reload the values that it repeatedly
  // needs.
  explicit Cache(std::size_t capacity_bytes, Count count = {}, std::size_t recent_bytes = 0)
      : capacity_(capacity_bytes), max_recent_bytes_(recent_bytes), count_(std::move(count)) {}

  // Returns the value for `key`, loading it by `load() -> Loaded` if needed. One of several concurrent callers loads.
  // The others wait, each until its own `stop`, and then throw Cancelled. If the load throws Cancelled, one of the
  // waiting callers loads instead.
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
          landed_.wait_for(lock, kPollInterval);
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

  // Returns whether a key is cached. Does not count as a use.
  bool holds(const Key& key) const {
    std::lock_guard lock(mutex_);
    return entries_.count(key) > 0;
  }

  // Returns the cached value, possibly a null pointer; nullopt if not cached. Counts as a use.
  std::optional<Pointer> find(const Key& key) {
    std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    return found == entries_.end() ? std::nullopt : std::optional(used(found));
  }

  // Returns the cached value, or null. Does not count as a use.
  Pointer peek(const Key& key) const {
    std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    return found == entries_.end() ? nullptr : found->second.value;
  }

  // Replaces a value by another with the same content, if `before` is still cached.
  void replace(const Key& key, const Pointer& before, Pointer value, std::size_t bytes) {
    std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    if (found == entries_.end() || found->second.value != before) return;
    bytes_ += bytes - found->second.bytes;
    if (found->second.recent) recent_bytes_ += bytes - found->second.bytes;
    found->second.value = std::move(value);
    found->second.bytes = bytes;
  }

  void erase(const Key& key) {
    std::lock_guard lock(mutex_);
    if (const auto found = entries_.find(key); found != entries_.end()) drop(found);
  }

  // Reserves bytes of the budget for memory outside the cache; replaces the previous reservation.
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
  // Points to the map's elements, whose addresses are stable.
  using LruList = std::list<std::pair<const Key, Entry>*>;
  struct Entry {
    Pointer value;
    std::size_t bytes = 0;
    bool recent = true;  // in recent_, else in older_
    typename LruList::iterator lru_position{};
  };
  // A load in progress, shared by its waiting callers.
  struct Flight {
    bool done = false, given_up = false;  // given_up: the loading caller was cancelled
    Pointer value;
    std::exception_ptr error;
  };
  using Entries = std::unordered_map<Key, Entry, Hash>;

  template <typename T>
  T locked(const T& value) const {
    std::lock_guard lock(mutex_);
    return value;
  }

  // Marks an entry as used now and returns its value.
  Pointer used(typename Entries::iterator found) {
    ++hits_;
    Entry& entry = found->second;
    recent_.splice(recent_.begin(), entry.recent ? recent_ : older_, entry.lru_position);
    if (!entry.recent) recent_bytes_ += entry.bytes;
    entry.recent = true;
    spill();
    return entry.value;
  }

  // Moves the least recent entries from recent_ to older_ until recent_ is within its limit.
  void spill() {
    while (recent_bytes_ > max_recent_bytes_) {
      Entry& last = recent_.back()->second;
      older_.splice(older_.begin(), recent_, last.lru_position);
      last.recent = false;
      recent_bytes_ -= last.bytes;
    }
  }

  // Ends a flight with its value: caches it as the most recent entry, and wakes the waiting callers.
  void land(const Key& key, Flight& flight, Loaded loaded) {
    std::lock_guard lock(mutex_);
    const std::size_t bytes = count_.add && loaded.value ? count_.add(*loaded.value) : loaded.bytes;
    flight.value = loaded.value;
    flight.done = true;
    flights_.erase(key);
    const auto entry = entries_.insert_or_assign(key, Entry{std::move(loaded.value), loaded.bytes}).first;
    recent_.push_front(&*entry);
    entry->second.lru_position = recent_.begin();
    recent_bytes_ += loaded.bytes;
    spill();
    bytes_ += bytes;
    evict(kMaxSkips);
    landed_.notify_all();
  }

  // Ends a flight without a value; waiting callers throw the error, or try themselves if there is none.
  void fail(const Key& key, Flight& flight, const std::exception_ptr& error) {
    std::lock_guard lock(mutex_);
    flight.error = error;
    flight.done = true;
    flights_.erase(key);
    landed_.notify_all();
  }

  // Evicts entries until the budget holds. Skips entries in use: they stay in memory anyway, and dropping them would
  // only hide them from the budget. A skipped entry moves to the front, so that the next eviction starts at others;
  // after `max_skips` of them this one gives up.
  void evict(std::size_t max_skips) {
    while (bytes_ + reserved_ > capacity_ && !older_.empty()) {
      auto& [key, entry] = *older_.back();
      if (entry.value.use_count() <= 1) {
        drop(entries_.find(key));
        ++evictions_;
      } else if (max_skips-- > 0) {
        older_.splice(older_.begin(), older_, entry.lru_position);
      } else {
        return;
      }
    }
  }

  void drop(typename Entries::iterator found) {
    const Entry& entry = found->second;
    bytes_ -= count_.remove && entry.value ? count_.remove(*entry.value) : entry.bytes;
    if (entry.recent) recent_bytes_ -= entry.bytes;
    (entry.recent ? recent_ : older_).erase(entry.lru_position);
    entries_.erase(found);
  }

  mutable std::mutex mutex_;
  std::condition_variable landed_;
  Entries entries_;
  LruList recent_, older_;  // most recently used first
  std::unordered_map<Key, std::shared_ptr<Flight>, Hash> flights_;
  static constexpr std::size_t kMaxSkips = 256;
  std::size_t capacity_, max_recent_bytes_, bytes_ = 0, recent_bytes_ = 0, reserved_ = 0;
  Count count_;
  std::uint64_t hits_ = 0, misses_ = 0, evictions_ = 0;
};

}  // namespace selenograph::dem
