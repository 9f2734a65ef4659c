#include "dem/terrain/subdivided.h"

#include <algorithm>
#include <cmath>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {
namespace {

// A place in a quad, from its south-west corner, in quads.
struct InQuad {
  double fx, fy;
};

// Adds to `sum` the values of the corners of the triangle that the place is in, weighted; corners with weight zero may
// be void. `at(j, i)`: of the corner in row j, column i.
template <typename Value, typename At>
Value on_triangle(const InQuad& p, Value sum, const At& at) {
  const auto add = [&](double weight, int j, int i) {
    if (weight != 0) sum += weight * at(j, i);
  };
  if (p.fx + p.fy <= 1)
    add(1 - p.fx - p.fy, 0, 0), add(p.fx, 0, 1), add(p.fy, 1, 0);
  else
    add(p.fx + p.fy - 1, 1, 1), add(1 - p.fx, 1, 0), add(1 - p.fy, 0, 1);
  return sum;
}

}  // namespace

std::shared_ptr<const Block> subdivided(const Block& coarse, const BlockId& id) {
  auto block = std::make_shared<Block>();
  block->id = id;
  block->extent = extent_of(id);
  block->error_m = 0;
  fill_trigonometry(*block);
  const BlockExtent &e = block->extent, &ce = coarse.extent;
  block->vertices.reserve(block->index(e.quads, e.quads) + 1);
  block->sources.reserve(block->index(e.quads, e.quads) + 1);
  float low = kHighestRelief_m, high = kLowestRelief_m;
  bool any = false;
  for (int r = 0; r <= e.quads; ++r)
    for (int c = 0; c <= e.quads; ++c) {
      const std::int32_t dy = e.lat0 + r * e.lat_step - ce.lat0, dx = e.lon0 + c * e.lon_step - ce.lon0;
      const int cr = std::min(dy / ce.lat_step, ce.quads - 1), cc = std::min(dx / ce.lon_step, ce.quads - 1);
      const double fy = static_cast<double>(dy) / ce.lat_step - cr, fx = static_cast<double>(dx) / ce.lon_step - cc;
      const auto corner = [&](int j, int i) -> const Vertex& { return coarse.vertices[coarse.index(cr + j, cc + i)]; };
      const auto height = [&](int j, int i) { return static_cast<double>(corner(j, i).height_m); };
      const auto normal = [&](int j, int i) -> Vec3 { return corner(j, i).normal.cast<double>(); };
      const InQuad place{fx, fy};
      const double h = on_triangle(place, 0.0, height);
      const Vec3 n = on_triangle(place, Vec3(Vec3::Zero()), normal);
      block->vertices.push_back({static_cast<float>(h), n.normalized().cast<float>()});
      block->sources.push_back(coarse.source(cr + (fy > 0.5), cc + (fx > 0.5)));
      if (std::isnan(h)) continue;
      any = true;
      low = std::min(low, static_cast<float>(h)), high = std::max(high, static_cast<float>(h));
    }
  if (!any) return nullptr;
  block->pack();
  block->min_m = low, block->max_m = high;
  return block;
}

}  // namespace selenograph::dem
