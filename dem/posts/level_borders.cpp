#include "dem/posts/level_borders.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <tuple>
#include <utility>

#include "dem/base/smoothstep.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {
namespace {

// Returns true if a level's posts at a latitude are farther apart than a window's, along meridians or parallels.
bool is_coarser(const PostWindow& w, int level, std::int64_t lat) {
  const BlockExtent e = extent_of(block_at(level, lat, 0));
  return e.lat_step > std::abs(w.lat_step) || e.lon_step > w.lon_step;
}

}  // namespace

std::vector<int> files_touching(const Catalogue& catalogue, const BlockId& id, double margin_deg) {
  const BlockExtent e = extent_of(id);
  const double west = static_cast<double>(e.lon0) / kTicksPerDegree - 180,
               east = static_cast<double>(e.lon1()) / kTicksPerDegree - 180;
  return catalogue.touching(lat_deg_of(e.lat0), lat_deg_of(e.lat1()), west, east, margin_deg);
}

bool any_file_within(const Catalogue& catalogue, const BlockId& id) {
  constexpr double kBorder_deg = 1e-6;  // 3 cm
  if (!files_touching(catalogue, id, -kBorder_deg).empty()) return true;
  if (catalogue.rasters().empty()) return false;
  const auto spacing_deg = [&](int i) { return 1 / catalogue.rasters()[static_cast<std::size_t>(i)].posts_per_degree; };
  const BlockExtent e = extent_of(id);
  const double side_deg = lat_deg_of(e.lat1()) - lat_deg_of(e.lat0),
               widest_deg = spacing_deg(0);  // files are sorted from coarse to fine
  if (side_deg >= widest_deg) return false;
  // A block between posts overlaps no file: accept it if it is within one post spacing of a file.
  const std::vector<int> candidates = files_touching(catalogue, id, widest_deg);
  return std::any_of(candidates.begin(), candidates.end(), [&](int i) {
    if (side_deg >= spacing_deg(i)) return false;
    const std::vector<int> near_files = files_touching(catalogue, id, spacing_deg(i));
    return std::binary_search(near_files.begin(), near_files.end(), i);
  });
}

LevelBorders::LevelBorders(const Catalogue& catalogue) : catalogue_(catalogue) {
  for (const RasterInfo& info : catalogue.rasters()) levels_.push_back(level_needed(info));
  any_ = std::any_of(levels_.begin(), levels_.end(), [&](int level) { return level != levels_.front(); });
  if (any_) strata_ = kStrataOfLayers;
}

ChunkLevels LevelBorders::levels_of(const BlockId& node) const {
  if (const auto found = levels_cache_.find(node); found != levels_cache_.end()) return found->second;
  return levels_cache_.emplace(node, compute_levels(node)).first->second;
}

// Decides whether the chunk at a node is made from the posts, and to which level it reaches: to the finest posts of the
// files that touch it, if that is not too many octaves below the node.
ChunkLevels LevelBorders::compute_levels(const BlockId& node) const {
  const auto finest_at = [&](const BlockId& id) {
    int finest = 0;
    for (const int i : files_touching(catalogue_, id, 0))
      finest = std::max(finest, levels_[static_cast<std::size_t>(i)]);
    return finest;
  };
  ChunkLevels chunk;
  chunk.exists = any_file_within(catalogue_, node);
  const auto next_stratum = std::upper_bound(strata_.begin(), strata_.end(), node.level);
  // Limit the chunk to kChunkOctaves. Only chunks of the last stratum may reach finer than the last stratum's level.
  const int finest_allowed =
      next_stratum == strata_.end() ? kMaxLevel : std::min(node.level + kChunkOctaves, strata_.back());
  int needed = std::max(node.level, finest_at(node));
  chunk.direct = needed <= finest_allowed;
  // Near finer posts, a coarse layer gets posts so dense that each block's corners are posts (kMaxLevelsApart).
  if (chunk.direct && !std::binary_search(kStrata.begin(), kStrata.end(), node.level)) {
    const int stratum_above = *(std::lower_bound(kStrata.begin(), kStrata.end(), node.level) - 1);
    const int finest_nearby = finest_at(ancestor_of(node, stratum_above));
    needed = std::max(needed, std::min(finest_nearby - kMaxLevelsApart, finest_allowed));
  }
  chunk.base_level = chunk.direct ? needed : *next_stratum;
  return chunk;
}

ChunkNode LevelBorders::chunk_of(const BlockId& id) const {
  const BlockId root = id.level <= kRootLevel ? BlockId{kRootLevel, id.row, id.col} : ancestor_of(id, kRootLevel);
  ChunkNode chunk{root, levels_of(root)};
  while (!chunk.levels.direct && id.level >= chunk.levels.base_level) {
    chunk.node = ancestor_of(id, chunk.levels.base_level);
    chunk.levels = levels_of(chunk.node);
  }
  return chunk;
}

// Walks along an edge of coarser posts, from neighbouring chunk to neighbouring chunk, and adds the sections that
// adjoin finer chunks. `outside`: the tick across the edge that lies just beyond it, in the neighbours.
void LevelBorders::add_finer_along(const LevelBorder& edge, std::int64_t outside,
                                   std::vector<LevelBorder>& found) const {
  std::int64_t section_end = -1;  // of the section added last: sections that touch are merged
  for (std::int64_t at = edge.from; at < edge.to;) {
    const std::int64_t lat = edge.along_parallel ? outside : at, lon = edge.along_parallel ? at : outside;
    const ChunkNode neighbour = chunk_of(block_at(strata_.back(), lat, wrap_lon(lon)));
    const BlockExtent e = extent_of(neighbour.node);
    // Round both ends outward to posts of the coarser side.
    const std::int64_t from = edge.from + floor_div(at - edge.from, edge.step) * edge.step;
    at = std::min<std::int64_t>(edge.along_parallel ? e.lon1() : e.lat1(), edge.to);
    if (!neighbour.levels.exists || neighbour.levels.base_level <= edge.level) continue;
    if (from > section_end) {
      found.push_back(edge);
      found.back().from = from;
    }
    section_end = edge.from - floor_div(edge.from - at, edge.step) * edge.step;
    found.back().to = section_end;
  }
}

// Adds the borders of a node with finer neighbours on any of its four sides. `level`: level of the node's posts.
void LevelBorders::add_borders_of(const BlockId& node, int level, std::vector<LevelBorder>& found) const {
  const BlockExtent e = extent_of(node);
  const Tick lat_step = lat_step_of(level);
  // Use the longitude step of the row nearest to the equator, where quads are narrowest in degrees.
  const Tick equatorward_lat = std::clamp(kLatTicks / 2, e.lat0, e.lat1() - 1);
  const Tick lon_step = extent_of(block_at(level, equatorward_lat, e.lon0)).lon_step;
  for (const bool east : {false, true})
    add_finer_along({false, east ? e.lon1() : e.lon0, e.lat0, e.lat1(), level, lat_step, lon_step},
                    east ? e.lon1() : std::int64_t{e.lon0} - 1, found);
  for (const bool north : {false, true}) {
    const Tick at = north ? e.lat1() : e.lat0, inside = north ? at - 1 : at, outside = north ? at : at - 1;
    if (outside < 0 || outside >= kLatTicks) continue;
    add_finer_along({true, at, e.lon0, e.lon1(), level, extent_of(block_at(level, inside, e.lon0)).lon_step, lat_step},
                    outside, found);
  }
}

namespace {

// Range of ticks around a window's posts that a node's quads may reach into.
struct Surroundings {
  std::int64_t south, north, west, east;
};

// Returns the window extended by one quad of the extent on each side, clamped at the poles.
Surroundings around(const PostWindow& w, const BlockExtent& e) {
  const std::int64_t lat1 = w.lat0 + std::int64_t{w.rows - 1} * w.lat_step,
                     lon1 = w.lon0 + std::int64_t{w.cols - 1} * w.lon_step;
  return {std::max<std::int64_t>(std::min(w.lat0, lat1) - e.lat_step, 0),
          std::min<std::int64_t>(std::max(w.lat0, lat1) + e.lat_step, kLatTicks - 1), w.lon0 - e.lon_step,
          lon1 + e.lon_step};
}

// Returns how far, in ticks, a node lies east of the westernmost column of such nodes that reaches into the window's
// surroundings; empty if the node does not reach into them.
std::optional<std::int64_t> eastward(const PostWindow& w, const BlockId& node) {
  const BlockExtent e = extent_of(node);
  const Surroundings s = around(w, e);
  if (e.lat0 > s.north || e.lat1() <= s.south) return std::nullopt;
  const std::int64_t width = e.lon1() - e.lon0, first_west = floor_div(s.west, width) * width;
  const std::int64_t offset = wrap_lon(e.lon0 - first_west);
  return first_west + offset <= s.east ? std::optional(offset) : std::nullopt;
}

// Returns the nodes that reach into a window's surroundings, from south to north, then eastward from the window's west.
std::vector<BlockId> near_window(const PostWindow& w, const std::vector<BlockId>& nodes) {
  std::vector<std::tuple<int, std::int64_t, BlockId>> found;
  for (const BlockId& node : nodes)
    if (const auto offset = eastward(w, node)) found.emplace_back(node.row, *offset, node);
  std::sort(found.begin(), found.end());
  std::vector<BlockId> sorted;
  sorted.reserve(found.size());
  for (const auto& [row, offset, node] : found) sorted.push_back(node);
  return sorted;
}

// Adds the node's descendants at `level`, or the node itself if it is of that level.
void add_descendants(const BlockId& node, int level, std::vector<BlockId>& found) {
  if (node.level == level) return found.push_back(node);
  for (const BlockId& child : children_of(node)) add_descendants(child, level, found);
}

// Returns the root nodes of all rows that a window's surroundings touch, at all longitudes.
std::vector<BlockId> roots_around(const PostWindow& w) {
  const Surroundings s = around(w, extent_of({kRootLevel, 0, 0}));
  const std::int64_t side = kLatTicks / rows_of(kRootLevel);
  std::vector<BlockId> found;
  for (auto row = static_cast<int>(s.south / side); row <= static_cast<int>(s.north / side); ++row)
    for (int col = 0; col < columns_of(kRootLevel, row); ++col) found.push_back({kRootLevel, row, col});
  return found;
}

}  // namespace

// Descends from the roots, one stratum of chunks at a time: `nodes` are the nodes of one stratum.
std::vector<LevelBorder> LevelBorders::near(const PostWindow& w) const {
  std::vector<LevelBorder> found;
  if (!any_) return found;
  std::vector<BlockId> nodes = roots_around(w);
  while (!nodes.empty()) {
    std::vector<BlockId> finer;
    for (const BlockId& node : near_window(w, nodes)) {
      // All nodes have one level. Stop at a level that is no coarser than the window's posts: finer ones are not
      // either.
      const BlockExtent e = extent_of(node);
      const Surroundings s = around(w, e);
      if (!is_coarser(w, node.level, s.south) && !is_coarser(w, node.level, s.north)) return found;
      const ChunkLevels levels = levels_of(node);
      if (!levels.exists) continue;
      if (!levels.direct)
        add_descendants(node, levels.base_level, finer);
      else if (is_coarser(w, levels.base_level, e.lat0) || is_coarser(w, levels.base_level, e.lat1() - 1))
        add_borders_of(node, levels.base_level, found);
    }
    nodes = std::move(finer);
  }
  return found;
}

namespace {

// Ticks of the rows or the columns of a window.
struct Axis {
  std::int64_t first, step;
  int count;
  std::int64_t tick(int i) const { return first + i * step; }
};

// Returns the range of posts (first, past the last) of an axis that lie between two ticks.
std::pair<int, int> between(const Axis& axis, std::int64_t low, std::int64_t high) {
  int first = 0, past = axis.count;
  while (first < past && !(axis.tick(first) >= low && axis.tick(first) <= high)) ++first;
  while (past > first && !(axis.tick(past - 1) >= low && axis.tick(past - 1) <= high)) --past;
  return {first, past};
}

// Returns how far the coarser side's straight edges are above the composed heights, m, at each post of `along`, whose
// ticks lie within the border.
std::vector<double> gap_along(const LevelBorder& b, const Axis& along, const ComposeLine& compose) {
  // Composes `count` posts on the border.
  const auto compose_on_border = [&](std::int64_t first, std::int64_t step, std::int64_t count) {
    const auto n = static_cast<int>(count);
    PostWindow w;
    w.lat0 = b.along_parallel ? b.at : first;
    w.lon0 = b.along_parallel ? first : b.at;
    (b.along_parallel ? w.lon_step : w.lat_step) = step;
    w.rows = b.along_parallel ? 1 : n;
    w.cols = b.along_parallel ? n : 1;
    return compose(w);
  };
  const std::vector<float> surface_m = compose_on_border(along.first, along.step, along.count);
  const std::int64_t end = along.tick(along.count - 1), low = std::min(along.first, end),
                     high = std::max(along.first, end);
  // Compose only the coarser posts that enclose the range from `low` to `high`.
  const std::int64_t quads = (b.to - b.from) / b.step;
  const std::int64_t first = std::min((low - b.from) / b.step, quads - 1);
  const std::int64_t last = std::min((high - b.from) / b.step + 1, quads);
  const std::vector<float> coarse_m = compose_on_border(b.from + first * b.step, b.step, last - first + 1);
  std::vector<double> gap_m;
  for (int i = 0; i < along.count; ++i) {
    const std::int64_t ticks_from_first = along.tick(i) - b.from - first * b.step;
    const auto k = static_cast<std::size_t>(std::min(ticks_from_first / b.step, last - first - 1));
    const double t = static_cast<double>(ticks_from_first) / b.step - static_cast<double>(k);
    const double edge_m = (1 - t) * static_cast<double>(coarse_m[k]) + t * static_cast<double>(coarse_m[k + 1]);
    gap_m.push_back(edge_m - static_cast<double>(surface_m[static_cast<std::size_t>(i)]));
  }
  return gap_m;
}

// Returns the weight of the gap: 1 on the border, smoothly down to 0 one quad of the coarser side away from it.
double transition_weight(std::int64_t distance_ticks, Tick reach_ticks) {
  return 1 - smoothstep(static_cast<double>(std::abs(distance_ticks)) / reach_ticks);
}

// Returns the same border, `turns` whole turns further around the globe.
LevelBorder turned(LevelBorder b, std::int64_t turns) {
  if (b.along_parallel) {
    b.from += turns * kLonTicks;
    b.to += turns * kLonTicks;
  } else {
    b.at += turns * kLonTicks;
  }
  return b;
}

// Returns metres per tick, measured across a border at a latitude.
double metres_per_tick_across(const LevelBorder& b, std::int64_t lat) {
  const double along_meridian_m = kMetresPerDegree / kTicksPerDegree;
  return b.along_parallel ? along_meridian_m : along_meridian_m * std::cos(lat_deg_of(lat) * kRadiansPerDegree);
}

// Returns the weight of a post by its distances from the border and from finer layers: 1 on the border and far from
// finer posts, 0 at finer posts, which must not move.
double weight_near_finer(double border_m, double finer_m) {
  return border_m == 0 || std::isinf(finer_m) ? 1 : finer_m / (finer_m + border_m);
}

// Adds the weighted gap of one border to the heights of a window's posts. Posts that are finer than the border's
// triangles keep their heights.
void join_along(const LevelBorder& b, const LevelBorders& borders, const PostWindow& w, const ComposeLine& compose,
                std::span<const SourceMark> sources, std::span<const float> finer_distance_m, float* heights_m) {
  const Axis rows{w.lat0, w.lat_step, w.rows}, cols{w.lon0, w.lon_step, w.cols};
  const Axis &along = b.along_parallel ? cols : rows, &across = b.along_parallel ? rows : cols;
  const auto [first_along, past_along] = between(along, b.from, b.to);
  const auto [first_across, past_across] = between(across, b.at - b.reach + 1, b.at + b.reach - 1);
  if (first_along == past_along || first_across == past_across) return;
  const std::vector<double> gaps_m =
      gap_along(b, {along.tick(first_along), along.step, past_along - first_along}, compose);
  for (int i = first_along; i < past_along; ++i)
    for (int j = first_across; j < past_across; ++j) {
      const int r = b.along_parallel ? j : i, c = b.along_parallel ? i : j;
      const std::size_t post =
          static_cast<std::size_t>(r) * static_cast<std::size_t>(w.cols) + static_cast<std::size_t>(c);
      const SourceIndex source = source_of(sources[post]);
      const double gap_m = gaps_m[static_cast<std::size_t>(i - first_along)];
      if (source == kNoSource || std::isnan(gap_m) || borders.level_of_file(source) > b.level) continue;
      double weight = transition_weight(across.tick(j) - b.at, b.reach);
      if (!finer_distance_m.empty())
        weight *= weight_near_finer(
            static_cast<double>(std::abs(across.tick(j) - b.at)) * metres_per_tick_across(b, rows.tick(r)),
            static_cast<double>(finer_distance_m[post]));
      heights_m[post] += static_cast<float>(weight * gap_m);
    }
}

}  // namespace

void join_levels(const LevelBorders& borders, const PostWindow& w, const ComposeLine& compose,
                 std::span<const SourceMark> sources, std::span<const float> finer_distance_m, float* heights_m) {
  for (const LevelBorder& b : borders.near(w)) {
    // Start with the last turn in which the border begins west of the window: a window is at most one turn wide.
    const std::int64_t first_turn = floor_div(w.lon0 - (b.along_parallel ? b.from : b.at), kLonTicks);
    for (const std::int64_t turn : {first_turn, first_turn + 1, first_turn + 2})
      join_along(turned(b, turn), borders, w, compose, sources, finer_distance_m, heights_m);
  }
}

}  // namespace selenograph::dem
