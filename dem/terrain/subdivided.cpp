#include "dem/terrain/subdivided.h"

#include <algorithm>
#include <cmath>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {
namespace {

// A position in a quad, from its south-west corner, 0 to 1.
struct QuadPosition {
  double fx, fy;
};

// Interpolates on the triangle of a quad that contains a position, starting from `sum`. `at(j, i)` returns the value at
// the corner in row j, column i; corners of weight 0 may be void.
//
//   (1,0) o-----o (1,1)      lower triangle: fx + fy <= 1, corners (0,0), (0,1), (1,0)
//         | \   |            upper triangle: corners (1,1), (1,0), (0,1)
//         |   \ |
//   (0,0) o-----o (0,1)
template <typename Value, typename At>
Value on_triangle(const QuadPosition& p, Value sum, const At& at) {
  const auto add = [&](double weight, int j, int i) {
    if (weight != 0) sum += weight * at(j, i);
  };
  if (p.fx + p.fy <= 1) {
    add(1 - p.fx - p.fy, 0, 0);
    add(p.fx, 0, 1);
    add(p.fy, 1, 0);
  } else {
    add(p.fx + p.fy - 1, 1, 1);
    add(1 - p.fx, 1, 0);
    add(1 - p.fy, 0, 1);
  }
  return sum;
}

}  // namespace

// Samples the coarse block's triangles at the finer block's vertices.
std::shared_ptr<const Block> subdivided(const Block& coarse, const BlockId& id) {
  auto block = empty_block(id, extent_of(id));
  const BlockExtent &e = block->extent, &ce = coarse.extent;
  block->vertices.reserve(block->index(e.quads, e.quads) + 1);
  block->sources.reserve(block->index(e.quads, e.quads) + 1);
  float low = kHighestRelief_m, high = kLowestRelief_m;
  bool has_data = false;
  for (int r = 0; r <= e.quads; ++r)
    for (int c = 0; c <= e.quads; ++c) {
      const Tick dy = e.lat0 + r * e.lat_step - ce.lat0, dx = e.lon0 + c * e.lon_step - ce.lon0;
      // Quad of the coarse block, and the position in it.
      const int quad_r = std::min(steps_in(dy, ce.lat_step), ce.quads - 1),
                quad_c = std::min(steps_in(dx, ce.lon_step), ce.quads - 1);
      const double fy = static_cast<double>(dy) / static_cast<double>(ce.lat_step) - quad_r,
                   fx = static_cast<double>(dx) / static_cast<double>(ce.lon_step) - quad_c;
      const auto corner = [&](int j, int i) -> const Vertex& {
        return coarse.vertices[coarse.index(quad_r + j, quad_c + i)];
      };
      const auto height = [&](int j, int i) { return static_cast<double>(corner(j, i).height_m); };
      const auto normal = [&](int j, int i) -> Vec3 { return corner(j, i).normal.cast<double>(); };
      const QuadPosition position{fx, fy};
      const double h = on_triangle(position, 0.0, height);
      const Vec3 n = on_triangle(position, Vec3(Vec3::Zero()), normal);
      block->vertices.push_back({static_cast<float>(h), n.normalized().cast<float>()});
      block->sources.push_back(coarse.source(quad_r + (fy > 0.5), quad_c + (fx > 0.5)));  // nearest corner
      if (std::isnan(h)) continue;
      has_data = true;
      low = std::min(low, static_cast<float>(h));
      high = std::max(high, static_cast<float>(h));
    }
  if (!has_data) return nullptr;
  block->pack();
  block->min_m = low;
  block->max_m = high;
  return block;
}

}  // namespace selenograph::dem
