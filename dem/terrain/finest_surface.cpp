#include "dem/terrain/finest_surface.h"

#include <algorithm>
#include <cmath>

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
bool intersects_quad(const RadialRay& ray, const Block& block, FinestEdges& edges, int r, int c, HeightAnswer& answer) {
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
  FinestEdges edges(ray.terrain, *block, ray.stop);
  const auto [first_r, past_r] = edges.rows(r, c);
  const auto [first_c, past_c] = edges.columns(r, c);
  for (int quad_r = first_r; quad_r < past_r; ++quad_r)
    for (int quad_c = first_c; quad_c < past_c; ++quad_c)
      if (intersects_quad(ray, *block, edges, quad_r, quad_c, answer)) return true;
  return false;
}

}  // namespace

const FinestEdges::Edge& FinestEdges::edge(Side side) {
  std::optional<Edge>& found = edges_[static_cast<std::size_t>(side)];
  if (!found) found = find_edge(side);
  return *found;
}

FinestEdges::Edge FinestEdges::find_edge(Side side) {
  const BlockExtent& e = block_.extent;
  const bool is_parallel = side == Side::south || side == Side::north;
  // A tick just beyond the edge.
  const std::int64_t lat = side == Side::south   ? std::int64_t{e.lat0} - 1
                           : side == Side::north ? e.lat1()
                                                 : e.lat0,
                     lon = side == Side::west   ? std::int64_t{e.lon0} - 1
                           : side == Side::east ? e.lon1()
                                                : e.lon0;
  if (lat < 0 || lat >= kLatTicks) return {};
  if (!posts_level_) posts_level_ = terrain_.plain().posts_level(block_.id);
  const auto block_beyond = [&](int level) { return block_at(level, lat, wrap_lon(lon)); };
  const BlockId probe = block_beyond(kMaxLevel);
  const BlockId across = block_beyond(std::min(terrain_.finest_level(probe), block_.id.level));
  const bool coarser_posts = terrain_.plain().posts_level(probe) < *posts_level_;
  // Rows of blocks with different spacing in longitude interpolate different curves between their posts. As the mesh
  // does, take one side's heights on their common edge.
  const auto lon_shift_of_posts = [&](Tick lat_tick) {
    return lon_shift(*posts_level_, block_at(*posts_level_, lat_tick, e.lon0).row);
  };
  const bool other_posts = is_parallel && lon_shift_of_posts(lat) != lon_shift_of_posts(e.lat0);
  const bool takes_neighbours_heights = coarser_posts || (other_posts && across < block_.id);
  const BlockExtent across_extent = extent_of(across);
  const int stride =
      is_parallel ? steps_in(across_extent.lon_step, e.lon_step) : steps_in(across_extent.lat_step, e.lat_step);
  if (!takes_neighbours_heights && stride <= 1) return {};
  std::shared_ptr<const Block> neighbour = terrain_.block(across, stop_);
  if (!neighbour) return {};
  return {std::clamp(stride, 1, e.quads), takes_neighbours_heights ? std::move(neighbour) : nullptr};
}

bool FinestEdges::differ() {
  for (const Side side : {Side::south, Side::north, Side::west, Side::east})
    if (edge(side).differs()) return true;
  return false;
}

// A vertex on an edge that the coarser side lacks moves to the vertex before it that both have.
Vec3 FinestEdges::vertex(int r, int c) {
  const int quads = block_.extent.quads;
  const Edge none;
  const Edge& along_row = r == 0 ? edge(Side::south) : r == quads ? edge(Side::north) : none;
  const Edge& along_column = c == 0 ? edge(Side::west) : c == quads ? edge(Side::east) : none;
  const int common_r = r - r % along_column.stride, common_c = c - c % along_row.stride;
  float height_m = block_.vertices[block_.index(common_r, common_c)].height_m;
  for (const Edge* on_edge : {&along_row, &along_column})
    if (on_edge->source) {
      const std::int64_t lat = block_.extent.lat0 + std::int64_t{common_r} * block_.extent.lat_step,
                         lon = block_.extent.lon0 + std::int64_t{common_c} * block_.extent.lon_step;
      height_m = post_at(*on_edge->source, lat, lon).value_or(height_m);
    }
  return block_.position(common_r, common_c, static_cast<double>(height_m));
}

std::pair<int, int> FinestEdges::rows(int r, int c) {
  const int last = block_.extent.quads - 1;
  return group(r, c == 0 ? edge(Side::west).stride : c == last ? edge(Side::east).stride : 1);
}
std::pair<int, int> FinestEdges::columns(int r, int c) {
  const int last = block_.extent.quads - 1;
  return group(c, r == 0 ? edge(Side::south).stride : r == last ? edge(Side::north).stride : 1);
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
