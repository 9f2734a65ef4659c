// Height to which occluders reach toward the Sun, over coarse cells of light space: a sample above all occluders of its
// cell is lit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "engine/visibility/zbuffer/raster_kernels.h"

namespace selenograph::engine {

class ShadowReach {
 public:
  // Cells of per_u by per_v per metre, from (u0, v0) on. Points outside count in the nearest cell.
  ShadowReach(float u0, float v0, float per_u, float per_v, int columns, int rows);

  // Adds an occluder. It also counts in the cells next to its box.
  void add(const LightBox& occluder);

  // Sets reached[g] to 1 if a sample of the group g of sixteen may be in shadow, else to 0.
  void find_reached(const float* u, const float* v, const float* d, std::size_t groups, std::uint8_t* reached) const;

 private:
  float u0_, v0_, per_u_, per_v_;
  int columns_, rows_;
  std::vector<float> top_m_;  // highest d of occluders per cell; -infinity: none
};

}  // namespace selenograph::engine
