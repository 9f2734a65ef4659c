// Order of a campaign's frames, and their distribution to processes. The manifest alone determines both, so that all
// processes agree.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "api/json/json_reader.h"
#include "dem/grid/geodesy.h"

namespace selenograph::server {

// Returns the rank of a frame in the order of the terrain: the position of the point in view along a Hilbert curve, so
// that a frame finds the blocks of the one before it in the cache. kNoPose is the last rank, of a frame without a pose.
//
//   +--+  +--+
//   |  |  |  |     Hilbert curve of 4 x 4 cells:
//   +  +--+  +     neighbours on the curve are
//   |        |     neighbours in space
//   +--+  +--+
//      |  |
//   +--+  +--+
inline constexpr std::uint64_t kNoPose = ~std::uint64_t{0};
std::uint64_t terrain_key(const api::Json& request);

// Returns the approximate cost of rendering, in pixels.
std::uint64_t weight_of(const api::Json& request);

// Returns the position of a point along the Hilbert curve through the cube of +-1, by `bits` of each coordinate, at
// most 21.
std::uint64_t hilbert_index(const Vec3& point, int bits);

// A range of a sequence.
struct Span {
  std::size_t begin = 0, end = 0;
  std::size_t size() const { return end - begin; }
  bool operator==(const Span&) const = default;
};

// Cuts a sequence of these weights into `count` spans of about equal weight. Some are empty if there are fewer elements
// than spans.
std::vector<Span> cut_evenly(const std::vector<std::uint64_t>& weights, std::size_t count);

}  // namespace selenograph::server
