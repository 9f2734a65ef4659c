#include "dem/terrain/finest_surface.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "dem/grid/surface.h"
#include "dem/posts/level_borders.h"
#include "dem/terrain/pyramid_terrain.h"

namespace selenograph::dem {
namespace {

// Returns the range of quads, first and past the last, that share an edge of the coarser side with quad i.
std::pair<int, int> group(int i, int stride) { return {i - i % stride, i - i % stride + stride}; }

// A radial ray from the Moon's centre.
struct RadialRay {
  const Terrain& terrain;
  Vec3 direction;
  const StopToken& stop;
  double slack;  // tolerance outside a triangle's edges, in barycentric coordinates
};

// Returns whether the ray intersects a quad of the finest surface; then sets all of the answer but its place.
bool intersects_quad(const RadialRay& ray, const Block& block, const FinestEdges& edges, int r, int c,
                     HeightAnswer& answer) {
  for (const bool upper : {false, true}) {
    const QuadVertices q = vertices_of(r, c, upper);
    const auto vertex = [&](int i) { return edges.vertex(q.r[i], q.c[i]); };
    const auto distance = radial_distance({vertex(0), vertex(1), vertex(2)}, ray.direction, ray.slack);
    if (!distance) continue;
    answer.height_m = *distance - kMoonRadius_m;
    // The answer names one source: that of the triangle's first vertex.
    const SourceIndex source = source_of(block.source(q.r[0], q.c[0]));
    for (int i = 0; i < 3; ++i) {
      answer.filled |= is_filled(block.source(q.r[i], q.c[i]));
      answer.blended |= is_blended(block.source(q.r[i], q.c[i]));
    }
    answer.source = source == kNoSource ? -1 : static_cast<int>(source);
    if (answer.source >= 0)
      answer.post_spacing_m = ray.terrain.catalogue().rasters()[static_cast<std::size_t>(answer.source)].post_spacing_m;
    return true;
  }
  return false;
}

// Tests the quad whose south-west corner is at the given ticks. At a border where the finer side's vertices are
// dropped, also tests the quads along the same edge of the coarser side: their triangles have stretched.
bool intersects_quad_at(const RadialRay& ray, int level, Tick lat, Tick lon, HeightAnswer& answer) {
  const auto block = ray.terrain.block(block_at(level, lat, lon), ray.stop);
  if (!block) return false;
  const BlockExtent& e = block->extent;
  const int r = steps_in(lat - e.lat0, e.lat_step), c = steps_in(lon - e.lon0, e.lon_step);
  const FinestEdges edges(ray.terrain, *block, {r, r, c, c}, ray.stop);
  const auto [first_r, past_r] = edges.rows(r, c);
  const auto [first_c, past_c] = edges.columns(r, c);
  for (int quad_r = first_r; quad_r < past_r; ++quad_r)
    for (int quad_c = first_c; quad_c < past_c; ++quad_c)
      if (intersects_quad(ray, *block, edges, quad_r, quad_c, answer)) return true;
  return false;
}

}  // namespace

FinestEdges::FinestEdges(const Terrain& terrain, const Block& block, const Quads& quads, const StopToken& stop)
    : block_(block) {
  const BlockExtent& e = block.extent;
  std::optional<int> posts_level;  // of the block, found when needed
  // Finds the neighbour across an edge of the block. `lat`, `lon`: a tick just beyond the edge; `along_lon`: the edge
  // is a parallel.
  const auto edge = [&](std::int64_t lat, std::int64_t lon, bool along_lon) -> Edge {
    if (lat < 0 || lat >= kLatTicks) return {};
    if (!posts_level) posts_level = terrain.plain().posts_level(block.id);
    const auto block_beyond = [&](int level) { return block_at(level, lat, wrap_lon(lon)); };
    const BlockId probe = block_beyond(kMaxLevel);
    const BlockId across = block_beyond(std::min(terrain.finest_level(probe), block.id.level));
    const bool coarser_posts = terrain.plain().posts_level(probe) < *posts_level;
    // Rows of blocks with different spacing in longitude interpolate different curves between their posts. As the mesh
    // does, take one side's heights on their common edge.
    const auto lon_shift_of_posts = [&](Tick lat_tick) {
      return lon_shift(*posts_level, block_at(*posts_level, lat_tick, e.lon0).row);
    };
    const bool other_posts = along_lon && lon_shift_of_posts(lat) != lon_shift_of_posts(e.lat0);
    const bool takes_neighbours_heights = coarser_posts || (other_posts && across < block.id);
    const BlockExtent across_extent = extent_of(across);
    const int stride =
        along_lon ? steps_in(across_extent.lon_step, e.lon_step) : steps_in(across_extent.lat_step, e.lat_step);
    if (!takes_neighbours_heights && stride <= 1) return {};
    std::shared_ptr<const Block> neighbour = terrain.block(across, stop);
    if (!neighbour) return {};
    return {std::clamp(stride, 1, e.quads), takes_neighbours_heights ? std::move(neighbour) : nullptr};
  };
  if (quads.first_row == 0) south_ = edge(std::int64_t{e.lat0} - 1, e.lon0, true);
  if (quads.last_row == e.quads - 1) north_ = edge(e.lat1(), e.lon0, true);
  if (quads.first_column == 0) west_ = edge(e.lat0, std::int64_t{e.lon0} - 1, false);
  if (quads.last_column == e.quads - 1) east_ = edge(e.lat0, e.lon1(), false);
}

// A vertex on an edge that the coarser side lacks moves to the vertex before it that both have.
Vec3 FinestEdges::vertex(int r, int c) const {
  const int quads = block_.extent.quads;
  const Edge none;
  const Edge& along_row = r == 0 ? south_ : r == quads ? north_ : none;
  const Edge& along_column = c == 0 ? west_ : c == quads ? east_ : none;
  const int common_r = r - r % along_column.stride, common_c = c - c % along_row.stride;
  float height_m = block_.vertices[block_.index(common_r, common_c)].height_m;
  for (const Edge* edge : {&along_row, &along_column})
    if (edge->source) {
      const std::int64_t lat = block_.extent.lat0 + std::int64_t{common_r} * block_.extent.lat_step,
                         lon = block_.extent.lon0 + std::int64_t{common_c} * block_.extent.lon_step;
      height_m = post_at(*edge->source, lat, lon).value_or(height_m);
    }
  return block_.position(common_r, common_c, static_cast<double>(height_m));
}

std::pair<int, int> FinestEdges::rows(int r, int c) const {
  return group(r, c == 0 ? west_.stride : c == block_.extent.quads - 1 ? east_.stride : 1);
}
std::pair<int, int> FinestEdges::columns(int r, int c) const {
  return group(c, r == 0 ? south_.stride : r == block_.extent.quads - 1 ? north_.stride : 1);
}

// Intersects the radial ray at the position with the triangles of the finest surface around it.
HeightAnswer Terrain::height(double lat_deg, double lon_deg, const StopToken& stop) const {
  stop.check();
  HeightAnswer answer{lat_deg, wrap_lon_deg(lon_deg), std::nan(""), 0, -1, false};
  const double lat = (lat_deg + 90) * kTicksPerDegree, lon = (answer.lon_deg + 180) * kTicksPerDegree;  // ticks
  const BlockId probe = block_at(kMaxLevel, static_cast<Tick>(std::clamp(lat, 0.0, kLatTicks - 1.0)),
                                 wrap_lon(static_cast<std::int64_t>(lon)));
  // Wider than a block of kSmoothLevel (0.25 degrees), the largest block that is loaded below.
  constexpr double kFarFromAnyFile_deg = 0.3;
  if (!has_data(probe) && files_touching(catalogue(), probe, kFarFromAnyFile_deg).empty()) return answer;
  const int level = finest_level(probe);
  const double step = std::ldexp(1.0, kTickLevel - level);
  const double y = lat / step, x = lon / step;  // in posts of the finest level
  // Test the quad of the position first, then its neighbours: the mesh's edges are great circles, not parallels, so
  // that a position beside an edge may lie on the next quad's triangle.
  const auto find_triangle = [&](double slack) {
    const RadialRay ray{*this, to_cartesian({lat_deg, lon_deg, 0}).normalized(), stop, slack};
    for (const int dy : {0, -1, 1})
      for (const int dx : {0, -1, 1}) {
        const double row = std::floor(y) + dy, col = std::floor(x) + dx;
        if (row < 0 || row * step >= kLatTicks) continue;
        if (intersects_quad_at(ray, level, static_cast<Tick>(row * step),
                               wrap_lon(static_cast<std::int64_t>(col * step)), answer))
          return true;
      }
    return false;
  };
  // Repeat with more slack if rounding misses all triangles: at a pole they are slivers a tenth of a millimetre wide.
  if (!find_triangle(1e-9)) find_triangle(1e-3);
  return answer;
}

}  // namespace selenograph::dem
