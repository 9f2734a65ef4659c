// How high casters reach toward the Sun, over coarse cells of light space: a sample above all casters of its cell is
// lit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "engine/visibility/zbuffer/raster_kernels.h"

namespace selenograph::engine {

class ShadowReach {
 public:
  // Cells of per_u by per_v a metre, from (u0, v0) on. What is beside them counts as in the nearest.
  ShadowReach(float u0, float v0, float per_u, float per_v, int columns, int rows);

  // A caster; it counts in the cells beside its box, too.
  void add(const LightBox& caster);

  // For groups of sixteen samples: whether one of them may be in shadow.
  void find_reached(const float* u, const float* v, const float* d, std::size_t groups, std::uint8_t* reached) const;

 private:
  float u0_, v0_, per_u_, per_v_;
  int columns_, rows_;
  std::vector<float> top_m_;  // d; -infinity: no caster
};

}  // namespace selenograph::engine
