// Cache keys for values that depend on many inputs: a hash of 128 bits stands for all of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "dem/base/hash.h"
#include "dem/grid/geodesy.h"

namespace selenograph::engine {

struct ContentKey {
  std::uint64_t low, high;
  bool operator==(const ContentKey&) const = default;
};
struct ContentKeyHash {
  std::size_t operator()(const ContentKey& key) const { return key.low; }
};

// Hashes the added values in order.
class ContentHash {
 public:
  // Adds values, whose type must have no padding.
  template <typename T>
  void add(const T* values, std::size_t count) {
    static_assert(std::is_floating_point_v<T> || std::has_unique_object_representations_v<T>);
    hash_.add(values, count * sizeof(T));
  }
  template <typename T>
  void add(const T& value) {
    add(&value, 1);
  }
  void add(const Vec3& v) { add(v.data(), 3); }

  ContentKey key() const {
    const auto [low, high] = hash_.digest_128();
    return {low, high};
  }

 private:
  dem::StreamedHash hash_;
};

}  // namespace selenograph::engine
