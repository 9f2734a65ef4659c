#include "dem/posts/level_borders.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace selenograph::dem {
namespace {

int lat_step_of(int level) { return 1 << (kTickLevel - level); }

// The node of a stratum at a place.
BlockId node_at(std::size_t stratum, std::int64_t lat, std::int64_t lon) {
  return block_at(kStrata[stratum], static_cast<std::int32_t>(lat), wrap_lon(lon));
}

// Whether a level's posts at a latitude are farther apart than a window's, along meridians or parallels.
bool is_coarser(const PostWindow& w, int level, std::int64_t lat) {
  const BlockExtent e = extent_of(block_at(level, static_cast<std::int32_t>(lat), 0));
  return e.lat_step > std::abs(w.lat_step) || e.lon_step > w.lon_step;
}

}  // namespace

std::vector<int> files_touching(const Catalogue& catalogue, const BlockId& id, double margin_deg) {
  const BlockExtent e = extent_of(id);
  const double west = static_cast<double>(e.lon0) / kTicksPerDegree - 180,
               east = static_cast<double>(e.lon1()) / kTicksPerDegree - 180;
  return catalogue.touching(lat_deg_of(e.lat0), lat_deg_of(e.lat1()), west, east, margin_deg);
}

std::vector<int> files_within(const Catalogue& catalogue, const BlockId& id) {
  constexpr double kBorder_deg = 1e-6;  // 3 cm
  return files_touching(catalogue, id, -kBorder_deg);
}

LevelBorders::LevelBorders(const Catalogue& catalogue) : catalogue_(catalogue) {
  for (const RasterInfo& info : catalogue.rasters()) levels_.push_back(level_needed(info));
  any_ = std::any_of(levels_.begin(), levels_.end(), [&](int level) { return level != levels_.front(); });
}

ChunkLevels LevelBorders::levels_of(const BlockId& node, std::size_t stratum) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = known_.find(node); found != known_.end()) return found->second;
  }
  int needed = node.level;
  for (const int i : files_touching(catalogue_, node, 0))
    needed = std::max(needed, levels_[static_cast<std::size_t>(i)]);
  ChunkLevels made;
  made.exists = !files_within(catalogue_, node).empty();
  made.direct = needed <= node.level + kChunkOctaves;
  made.base_level = made.direct ? needed : kStrata[stratum + 1];
  const std::lock_guard lock(mutex_);
  return known_.emplace(node, made).first->second;
}

// Whether the posts of a node, or of the chunk that it is a part of, are finer than those of a level.
bool LevelBorders::is_finer(const BlockId& node, std::size_t stratum, int level) const {
  for (std::size_t s = 0;; ++s) {
    const ChunkLevels here = levels_of(s == stratum ? node : ancestor_of(node, kStrata[s]), s);
    if (!here.exists) return false;
    if (here.direct || s == stratum) return !here.direct || here.base_level > level;
  }
}

// `level`: of the node's own posts.
void LevelBorders::add_borders_of(const BlockId& node, std::size_t stratum, int level,
                                  std::vector<LevelBorder>& found) const {
  const BlockExtent e = extent_of(node);
  const std::int32_t lat_step = lat_step_of(level);
  // Rows nearer the equator have narrower quads.
  const std::int32_t nearest = std::clamp(kLatTicks / 2, e.lat0, e.lat1() - 1);
  const std::int32_t lon_step = extent_of(block_at(level, nearest, e.lon0)).lon_step;
  for (const bool east : {false, true})
    if (is_finer(node_at(stratum, e.lat0, east ? e.lon1() : std::int64_t{e.lon0} - 1), stratum, level))
      found.push_back({false, east ? e.lon1() : e.lon0, e.lat0, e.lat1(), level, lat_step, lon_step});
  for (const bool north : {false, true}) {
    const std::int32_t at = north ? e.lat1() : e.lat0, inside = north ? at - 1 : at, outside = north ? at : at - 1;
    if (outside < 0 || outside >= kLatTicks) continue;
    // Blocks beyond may be wider or narrower.
    for (std::int32_t lon = e.lon0; lon < e.lon1();) {
      const BlockId beyond = node_at(stratum, outside, lon);
      const std::int32_t to = std::min(extent_of(beyond).lon1(), e.lon1());
      if (is_finer(beyond, stratum, level))
        found.push_back({true, at, lon, to, level, extent_of(block_at(level, inside, lon)).lon_step, lat_step});
      lon = to;
    }
  }
}

std::vector<LevelBorder> LevelBorders::near(const PostWindow& w) const {
  std::vector<LevelBorder> found;
  if (!any_) return found;
  const std::int64_t lat1 = w.lat0 + std::int64_t{w.rows - 1} * w.lat_step,
                     lon1 = w.lon0 + std::int64_t{w.cols - 1} * w.lon_step;
  for (std::size_t s = 0; s < kStrata.size(); ++s) {
    const std::int32_t quad = lat_step_of(kStrata[s]);
    const std::int32_t side = quad * quads_per_side(kStrata[s]);
    const std::int64_t south = std::max<std::int64_t>(std::min(w.lat0, lat1) - quad, 0),
                       north = std::min<std::int64_t>(std::max(w.lat0, lat1) + quad, kLatTicks - 1);
    // Posts of such chunks, and of those beneath, are no coarser than the window's.
    if (!is_coarser(w, kStrata[s], south) && !is_coarser(w, kStrata[s], north)) break;
    for (std::int64_t row = south / side; row <= north / side; ++row) {
      const std::int64_t width = extent_of(node_at(s, row * side, 0)).lon1(), columns = kLonTicks / width;
      const std::int64_t margin = width / quads_per_side(kStrata[s]);
      const std::int64_t first = floor_div(w.lon0 - margin, width), last = floor_div(lon1 + margin, width);
      for (std::int64_t c = first; c <= std::min(last, first + columns - 1); ++c) {
        const BlockId node = node_at(s, row * side, c * width);
        if (s > 0 && levels_of(ancestor_of(node, kStrata[s - 1]), s - 1).direct) continue;  // no chunk of its own
        const ChunkLevels levels = levels_of(node, s);
        if (levels.exists && levels.direct &&
            (is_coarser(w, levels.base_level, row * side) || is_coarser(w, levels.base_level, (row + 1) * side - 1)))
          add_borders_of(node, s, levels.base_level, found);
      }
    }
  }
  return found;
}

namespace {

struct Axis {
  std::int64_t first, step;
  int count;
  std::int64_t tick(int i) const { return first + i * step; }
};

// The posts of an axis from the first to before the last that are between two ticks.
std::pair<int, int> between(const Axis& axis, std::int64_t low, std::int64_t high) {
  int first = 0, past = axis.count;
  while (first < past && !(axis.tick(first) >= low && axis.tick(first) <= high)) ++first;
  while (past > first && !(axis.tick(past - 1) >= low && axis.tick(past - 1) <= high)) --past;
  return {first, past};
}

// By how much the coarser posts' edge is above the composed heights, at some posts along a border.
std::vector<double> gap_along(const LevelBorder& b, const Axis& along, const ComposeLine& compose) {
  const auto line = [&](std::int64_t first, std::int64_t step, std::int64_t count) {
    const auto n = static_cast<int>(count);
    PostWindow w;
    if (b.along_parallel)
      w.lat0 = b.at, w.lon0 = first, w.lon_step = static_cast<std::int32_t>(step), w.rows = 1, w.cols = n;
    else
      w.lat0 = first, w.lon0 = b.at, w.lat_step = static_cast<std::int32_t>(step), w.rows = n, w.cols = 1;
    return compose(w);
  };
  const std::vector<float> heights = line(along.first, along.step, along.count);
  const std::int64_t end = along.tick(along.count - 1), low = std::min(along.first, end),
                     high = std::max(along.first, end);
  const std::int64_t all = (b.to - b.from) / b.step, first = std::min((low - b.from) / b.step, all - 1),
                     last = std::min((high - b.from) / b.step + 1, all);
  const std::vector<float> posts = line(b.from + first * b.step, b.step, last - first + 1);
  std::vector<double> gap;
  for (int i = 0; i < along.count; ++i) {
    const std::int64_t away = along.tick(i) - b.from - first * b.step;
    const auto k = static_cast<std::size_t>(std::min(away / b.step, last - first - 1));
    const double t = static_cast<double>(away) / b.step - static_cast<double>(k);
    const auto post = [&](std::size_t at) { return static_cast<double>(posts[at]); };
    gap.push_back((1 - t) * post(k) + t * post(k + 1) - static_cast<double>(heights[static_cast<std::size_t>(i)]));
  }
  return gap;
}

// 1 on the border, 0 a quad of the coarser side away from it.
double share(std::int64_t away, std::int32_t reach) {
  const double t = std::min(1.0, static_cast<double>(std::abs(away)) / reach);
  return 1 - t * t * (3 - 2 * t);
}

// The same border some turns around the globe further.
LevelBorder turned(LevelBorder b, std::int64_t turns) {
  if (b.along_parallel)
    b.from += turns * kLonTicks, b.to += turns * kLonTicks;
  else
    b.at += turns * kLonTicks;
  return b;
}

void join_along(const LevelBorder& b, const LevelBorders& borders, const PostWindow& w, const ComposeLine& compose,
                const SourceMark* sources, float* heights_m) {
  const Axis rows{w.lat0, w.lat_step, w.rows}, cols{w.lon0, w.lon_step, w.cols};
  const Axis &along = b.along_parallel ? cols : rows, &across = b.along_parallel ? rows : cols;
  const auto [first, past] = between(along, b.from, b.to);
  const auto [from, to] = between(across, b.at - b.reach + 1, b.at + b.reach - 1);
  if (first == past || from == to) return;
  const std::vector<double> gap = gap_along(b, {along.tick(first), along.step, past - first}, compose);
  for (int i = first; i < past; ++i)
    for (int j = from; j < to; ++j) {
      const int r = b.along_parallel ? j : i, c = b.along_parallel ? i : j;
      const std::size_t at =
          static_cast<std::size_t>(r) * static_cast<std::size_t>(w.cols) + static_cast<std::size_t>(c);
      const SourceIndex source = source_of(sources[at]);
      const double gap_m = gap[static_cast<std::size_t>(i - first)];
      if (source == kNoSource || std::isnan(gap_m) || borders.level_of_file(source) > b.level) continue;
      heights_m[at] += static_cast<float>(share(across.tick(j) - b.at, b.reach) * gap_m);
    }
}

}  // namespace

void join_levels(const LevelBorders& borders, const PostWindow& w, const ComposeLine& compose,
                 const SourceMark* sources, float* heights_m) {
  for (const LevelBorder& b : borders.near(w)) {
    // From the last turn in which the border begins west of the window; a window is at most one turn wide.
    const std::int64_t before = floor_div(w.lon0 - (b.along_parallel ? b.from : b.at), kLonTicks);
    for (const std::int64_t turn : {before, before + 1, before + 2})
      join_along(turned(b, turn), borders, w, compose, sources, heights_m);
  }
}

}  // namespace selenograph::dem
