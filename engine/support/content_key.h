// Keys of caches whose values depend on much: a hash of 128 bits stands for it.
#pragma once

#include <xxhash.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <type_traits>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

struct ContentKey {
  std::uint64_t low, high;
  bool operator==(const ContentKey&) const = default;
};
struct ContentKeyHash {
  std::size_t operator()(const ContentKey& key) const { return key.low; }
};

// Hashes what is added, in this order.
class ContentHash {
 public:
  ContentHash() : state_(XXH3_createState(), XXH3_freeState) { XXH3_128bits_reset(state_.get()); }

  // Values without padding.
  template <typename T>
  void add(const T* values, std::size_t count) {
    static_assert(std::is_floating_point_v<T> || std::has_unique_object_representations_v<T>);
    XXH3_128bits_update(state_.get(), values, count * sizeof(T));
  }
  template <typename T>
  void add(const T& value) {
    add(&value, 1);
  }
  void add(const Vec3& v) { add(v.data(), 3); }

  ContentKey key() const {
    const XXH128_hash_t hash = XXH3_128bits_digest(state_.get());
    return {hash.low64, hash.high64};
  }

 private:
  std::unique_ptr<XXH3_state_t, decltype(&XXH3_freeState)> state_;
};

}  // namespace selenograph::engine
