// Shards: the parts of a campaign that processes render, each independently of the others.
#pragma once

#include <cstddef>
#include <string>

namespace selenograph::server {

// The part of a campaign that one process renders.
struct Shard {
  std::size_t index = 0, of = 1;
};
// Parses "3/16" of --shard. Throws std::runtime_error.
Shard shard_of(const std::string& text);

// A range of a sequence.
struct Span {
  std::size_t begin = 0, end = 0;
  std::size_t size() const { return end - begin; }
};
// Returns the shard's part of `count` elements. The parts are contiguous, so that a frame finds the terrain of the one
// before it in the cache, and their sizes differ by one at most.
Span span_of(std::size_t count, const Shard& shard);

}  // namespace selenograph::server
