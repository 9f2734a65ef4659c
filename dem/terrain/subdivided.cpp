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

InterpolatedVertex interpolate(const Block& block, double lat_tick, double lon_tick) {
  const BlockExtent& e = block.extent;
  // Quad of the block, and the position in it.
  const double y = (lat_tick - static_cast<double>(e.lat0)) / static_cast<double>(e.lat_step),
               x = (lon_tick - static_cast<double>(e.lon0)) / static_cast<double>(e.lon_step);
  const int r = std::clamp(static_cast<int>(y), 0, e.quads - 1), c = std::clamp(static_cast<int>(x), 0, e.quads - 1);
  const double fy = y - r, fx = x - c;
  const auto corner = [&](int j, int i) -> const Vertex& { return block.vertices[block.index(r + j, c + i)]; };
  const auto height = [&](int j, int i) { return static_cast<double>(corner(j, i).height_m); };
  const auto normal = [&](int j, int i) -> Vec3 { return corner(j, i).normal.cast<double>(); };
  const QuadPosition position{fx, fy};
  const int nearest_r = r + (fy > 0.5), nearest_c = c + (fx > 0.5);
  InterpolatedVertex vertex{on_triangle(position, 0.0, height), on_triangle(position, Vec3(Vec3::zero()), normal),
                            block.source(nearest_r, nearest_c), block.shown(nearest_r, nearest_c)};
  if (!block.brightness.empty()) {
    const auto brightness = [&](int j, int i) {
      return static_cast<double>(block.brightness[block.index(r + j, c + i)]);
    };
    vertex.brightness = static_cast<std::uint16_t>(std::lround(on_triangle(position, 0.0, brightness)));
  }
  return vertex;
}

// Samples the coarse block's triangles at the finer block's vertices.
std::shared_ptr<const Block> subdivided(const Block& coarse, const BlockId& id) {
  auto block = empty_block(id, extent_of(id));
  const BlockExtent& e = block->extent;
  const std::size_t count = block->index(e.quads, e.quads) + 1;
  block->vertices.reserve(count);
  block->sources.reserve(count);
  if (!coarse.ground.empty()) block->ground.reserve(count);
  if (!coarse.brightness.empty()) block->brightness.reserve(count);
  float low = kHighestRelief_m, high = kLowestRelief_m;
  bool has_data = false;
  for (int r = 0; r <= e.quads; ++r)
    for (int c = 0; c <= e.quads; ++c) {
      const InterpolatedVertex vertex = interpolate(coarse, static_cast<double>(e.lat0 + r * e.lat_step),
                                                    static_cast<double>(e.lon0 + c * e.lon_step));
      const double h = vertex.height_m;
      block->vertices.push_back({static_cast<float>(h), vertex.normal.normalized().cast<float>()});
      block->sources.push_back(vertex.source);
      if (!coarse.ground.empty()) block->ground.push_back(vertex.ground);
      if (!coarse.brightness.empty()) block->brightness.push_back(vertex.brightness);
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
