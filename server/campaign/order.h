// Order of a campaign's frames, and their distribution to processes: determined by the manifest only, so that all
// processes agree.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "api/json/json_reader.h"
#include "dem/grid/geodesy.h"

namespace selenograph::server {

// Rank of a frame in the order of the terrain: along the Hilbert curve through the places in view. Without a pose:
// kNoPlace, the last.
inline constexpr std::uint64_t kNoPlace = ~std::uint64_t{0};
std::uint64_t terrain_key(const api::Json& request);

// Approximate cost of rendering, in pixels.
std::uint64_t weight_of(const api::Json& request);

// Position of a point along the Hilbert curve through the cube of +-1; `bits` of each coordinate count, at most 21.
// Neighbours on the curve are neighbours in space.
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
