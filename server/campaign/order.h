// In which order a campaign's frames are rendered, and which process renders which: decided by the manifest alone, so
// that every process of a campaign comes to the same answer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "api/json/json_reader.h"
#include "dem/grid/geodesy.h"

namespace selenograph::server {

// Where a frame comes in the order of the terrain: along the Hilbert curve through the places that are seen. Of one
// that says no pose: kNoPlace, the last.
inline constexpr std::uint64_t kNoPlace = ~std::uint64_t{0};
std::uint64_t terrain_key(const api::Json& request);

// What rendering it takes, about: in pixels.
std::uint64_t weight_of(const api::Json& request);

// How far along the Hilbert curve through the cube of +-1 a point is; `bits` of each coordinate count, 21 at most.
// Neighbours on the curve are neighbours in space.
std::uint64_t hilbert_index(const Vec3& point, int bits);

// A range of a sequence.
struct Span {
  std::size_t begin = 0, end = 0;
  std::size_t size() const { return end - begin; }
  bool operator==(const Span&) const = default;
};

// Cuts a sequence of these weights into `count` spans of about the same weight. Some are empty where there are more
// than elements.
std::vector<Span> cut_evenly(const std::vector<std::uint64_t>& weights, std::size_t count);

}  // namespace selenograph::server
