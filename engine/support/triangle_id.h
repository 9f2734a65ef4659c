// A triangle of the mesh in 32 bits: block, quad (by its south-west vertex), and half of the quad (dem/grid/surface.h).
//
//    31          13 12     7 6         1    0
//   +--------------+--------+-----------+-------+
//   | block        | row    | column    | upper |
//   +--------------+--------+-----------+-------+
#pragma once

#include <cstdint>

#include "dem/grid/surface.h"

namespace selenograph::engine {

class TriangleId {
 public:
  static constexpr std::uint32_t kMaxBlocks = 1U << 19;

  TriangleId() = default;
  explicit TriangleId(std::uint32_t packed) : packed_(packed) {}
  TriangleId(std::uint32_t block, int r, int c, bool upper)
      : packed_(block << 13 | static_cast<std::uint32_t>(r) << 7 | static_cast<std::uint32_t>(c) << 1 |
                (upper ? 1U : 0U)) {}

  std::uint32_t packed() const { return packed_; }
  std::uint32_t block() const { return packed_ >> 13; }
  int r() const { return static_cast<int>(packed_ >> 7 & 63); }
  int c() const { return static_cast<int>(packed_ >> 1 & 63); }
  bool upper() const { return (packed_ & 1) != 0; }
  TriangleId other_half() const { return TriangleId(packed_ ^ 1); }
  dem::QuadVertices vertices() const { return dem::vertices_of(r(), c(), upper()); }

 private:
  std::uint32_t packed_ = 0;
};

}  // namespace selenograph::engine
