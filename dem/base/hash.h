// Hashes of bytes by xxHash (Yann Collet).
#pragma once

#define XXH_INLINE_ALL
// Read memory by memcpy. By default xxHash 0.8.3 reads it as integers, which may not alias other types: when inlined,
// GCC 14 then hashes values that are stored only afterwards.
#define XXH_FORCE_MEMORY_ACCESS 0
#include <xxhash.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string_view>

namespace selenograph::dem {

// Returns the 64-bit XXH3 hash.
inline std::uint64_t hash_of(const void* bytes, std::size_t count, std::uint64_t seed = 0) {
  return XXH3_64bits_withSeed(bytes, count, seed);
}

// Returns the XXH64 hash. Fingerprints of catalogues use it: another hash would change every frame's content hash.
inline std::uint64_t xxh64_of(const void* bytes, std::size_t count, std::uint64_t seed) {
  return XXH64(bytes, count, seed);
}

struct Hash128 {
  std::uint64_t low, high;
};

// XXH3 hash of a sequence of values.
class StreamedHash {
 public:
  StreamedHash() : state_(XXH3_createState(), XXH3_freeState) { XXH3_64bits_reset(state_.get()); }
  void add(const void* bytes, std::size_t count) { XXH3_64bits_update(state_.get(), bytes, count); }
  void add(const auto& without_padding) { add(&without_padding, sizeof without_padding); }
  void add_text(std::string_view text) { add(text.data(), text.size()); }
  std::uint64_t digest() const { return XXH3_64bits_digest(state_.get()); }
  // Returns the 128-bit hash of the same values: both sizes share their state and updates (xxhash.h).
  Hash128 digest_128() const {
    const XXH128_hash_t hash = XXH3_128bits_digest(state_.get());
    return {hash.low64, hash.high64};
  }

 private:
  std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> state_;
};

}  // namespace selenograph::dem
