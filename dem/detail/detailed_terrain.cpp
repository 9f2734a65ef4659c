#include "dem/detail/detailed_terrain.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/detail/footprints.h"
#include "dem/terrain/surface_place.h"

namespace selenograph::dem {

DetailedTerrain::DetailedTerrain(std::shared_ptr<const PyramidTerrain> plain, std::shared_ptr<const Detail> detail)
    : plain_(std::move(plain)),
      detail_(std::move(detail)),
      layers_(*plain_, detail_->widest_m()),
      cache_(*plain_, detail_->preset()),
      posts_(*plain_, *detail_, layers_, cache_),
      maker_(*plain_, *detail_, layers_, posts_) {}

// Ask for the block of posts above this one: a small block may lie in the gap between the last posts of a file and the
// first of the next, where the terrain has a surface but no post.
bool DetailedTerrain::has_data(const BlockId& id) const {
  return plain_->has_data(ancestor_of(id, std::min(id.level, plain_->posts_level(id))));
}

bool DetailedTerrain::detail_reaches(const BlockId& id) const {
  if (detail_->preset().region.everywhere()) return true;
  const BlockId posts_block = ancestor_of(id, std::min(id.level, plain_->posts_level(id)));
  const Circle circle = circle_around(footprint_of(posts_block));
  // A descendant's circle may stick out of its ancestor's. The mean correction reaches some posts beyond the detail.
  constexpr double kMarginFactor = 1.01, kMarginPosts = 4;
  const int level = std::min(posts_block.level, layers_.coarsest_detail(id));
  return detail_->reaches(circle.middle, kMarginFactor * circle.radius_m + kMarginPosts * post_spacing_m(level));
}

int DetailedTerrain::posts_level(const BlockId& id) const {
  return has_data(id) && detail_reaches(id) ? std::max(plain_->finest_level(id), detail_->finest_level())
                                            : plain_->finest_level(id);
}

bool DetailedTerrain::has_detail(const BlockId& id) const {
  return id.level > layers_.coarsest_detail(id) && (detail_reaches(id) || id.level > plain_->posts_level(id));
}

bool DetailedTerrain::uses_coarse_posts_only(const BlockId& id) const {
  return layers_.coarsest(id) < std::min(id.level, plain_->posts_level(id)) && layers_.of(id)->size() == 1 &&
         has_detail(id);
}

double DetailedTerrain::left_out_size_m(const BlockId& id) const {
  const int coarsest = layers_.coarsest_detail(id);
  const int shown = id.level > coarsest ? Detail::smallest_octave(id.level) : std::numeric_limits<int>::max();
  return detail_->left_out_size_m(std::min(shown, Detail::past_largest_octave(coarsest)));
}

// Returns a block's bounds: those of the block itself where it has detail; else those of the plain block, widened by
// the detail and the bicubic curve that finer levels add.
NodeInfo DetailedTerrain::node(const BlockId& id, const StopToken& stop) const {
  const auto info_of = [](const Block& b) {
    return NodeInfo{b.error_m, b.min_m, b.max_m, false, {}, b.detail_error_m, b.left_out_size_m};
  };
  // Only unusable files make the plain terrain's node necessary. Skip it otherwise: a frame calls this for thousands of
  // blocks.
  const bool files_usable = !plain_->has_replacements();
  if (files_usable)
    if (const auto hit = cache_.find(GroundCache::Kind::block, id); hit && *hit) return info_of(**hit);
  if (has_detail(id)) {
    const auto detailed = block(id, stop);
    if (!detailed) return {};
    NodeInfo info = info_of(*detailed);
    if (!files_usable || !uses_coarse_posts_only(id)) info.replaced = plain_->node(id, stop).replaced;
    return info;
  }
  NodeInfo info = plain_->node(id, stop);
  if (info.empty || !detail_reaches(id)) return info;
  const int posts_level = layers_.coarsest(id);
  // The surface curves between the posts by about as much as posts deviate from the surface through every second one:
  // take that level's error as the bound. For much coarser levels take half of their own error. It is larger than the
  // bend, since rough ground is rougher over longer distances.
  constexpr int kMuchCoarser = 3;
  double bend_m = 0;
  if (id.level + kMuchCoarser <= posts_level)
    bend_m = info.error_m / 2;
  else if (posts_level > 0)
    bend_m = id.level < posts_level ? info.error_m : plain_->node(ancestor_of(id, posts_level - 1), stop).error_m;
  const double detail_error_m = bend_m + detail_->max_detail_m(layers_.coarsest_detail(id));
  info.error_m += detail_error_m;
  info.detail_error_m = detail_error_m;
  info.left_out_size_m = left_out_size_m(id);
  info.min_m -= static_cast<float>(detail_error_m);
  info.max_m += static_cast<float>(detail_error_m);
  return info;
}

std::optional<HeightRange> DetailedTerrain::heights_without_building(const BlockId& id, const StopToken& stop) const {
  std::optional<HeightRange> range = plain_->heights_without_building(id, stop);
  if (!range || !detail_reaches(id)) return range;
  // Catmull-Rom overshoots the posts' range by at most an eighth of it per axis; 0.3 covers both axes.
  const float margin_m =
      static_cast<float>(detail_->max_detail_m(layers_.coarsest_detail(id))) + 0.3F * (range->high - range->low);
  range->low -= margin_m;
  range->high += margin_m;
  return range;
}

// Returns bounds without making the block, where a coarser surface can give them. Only every third level of detail is
// made for its bounds:
//
//   levels finer than the posts   1 2 3 4 5 | 6     7 8   | 9     10 11 | 12 ...
//   bounds                        posts     | made  by 6  | made  by 9  | made
std::optional<NodeInfo> DetailedTerrain::outline(const BlockId& id, const StopToken& stop) const {
  constexpr int kLevelsFromPosts = 5, kLevelsApart = 3;
  if (!has_detail(id) || plain_->has_replacements() || id.level >= finest_level(id)) return std::nullopt;
  const LayeredPosts::Layers layers = layers_.of(id);
  const LayeredPosts::Layer& layer = layers->front();
  const int levels_below_posts = id.level - layer.level;
  if (layers->size() > 1 || levels_below_posts <= 0) return std::nullopt;
  const int levels_past_made = levels_below_posts - kLevelsFromPosts - 1;  // from the first level that is made on
  if (levels_past_made >= 0 && levels_past_made % kLevelsApart == 0) return std::nullopt;
  const auto heights = levels_past_made < 0
                           ? bounds_from_posts(id, layer, stop)
                           : bounds_from_ancestor(id, id.level - levels_past_made % kLevelsApart, stop);
  if (!heights) return std::nullopt;
  NodeInfo info{detail_->left_out_m(id.level, layer.detail_level), heights->low, heights->high, false, {}};
  info.detail_error_m = info.error_m;
  info.left_out_size_m = left_out_size_m(id);
  return info;
}

std::optional<HeightRange> DetailedTerrain::bounds_from_posts(const BlockId& id, const LayeredPosts::Layer& layer,
                                                              const StopToken& stop) const {
  constexpr auto kKind = GroundCache::Kind::outline;
  auto outline = cache_.find(kKind, id);
  if (!outline)
    outline = cache_.run_in_arena(posts_to_await(id), stop, [&] {
      return cache_.get(kKind, id, stop, [&] { return make_posts_outline(id, layer, stop); });
    });
  if (!*outline) return std::nullopt;
  return HeightRange{(*outline)->min_m, (*outline)->max_m};
}

// Widens the range of the posts around a block by what interpolation and detail may add.
std::shared_ptr<const Block> DetailedTerrain::make_posts_outline(const BlockId& id, const LayeredPosts::Layer& layer,
                                                                 const StopToken& stop) const {
  const std::optional<HeightRange> range = posts_.range_around(id, layer.level, stop);
  if (!range) return nullptr;
  // Catmull-Rom overshoots by 0.28 of the range. Next to a row whose posts are twice as far apart, the heights at posts
  // are themselves interpolated along the row and may overshoot, too.
  constexpr float kOvershoot = 0.6F;
  const float margin_m =
      kOvershoot * (range->high - range->low) + static_cast<float>(detail_->max_detail_m(layer.detail_level));
  auto outline = std::make_shared<Block>();
  outline->id = id;
  outline->min_m = range->low - margin_m;
  outline->max_m = range->high + margin_m;
  return outline;
}

// Takes the range of the ancestor's vertices over the block, widened by the ancestor's error.
std::optional<HeightRange> DetailedTerrain::bounds_from_ancestor(const BlockId& id, int level,
                                                                 const StopToken& stop) const {
  const auto coarser = block(ancestor_of(id, level), stop);
  if (!coarser) return std::nullopt;
  // Read the coarser block's vertices over the block, rounded outward. Its error bounds what lies between them.
  const BlockExtent e = extent_of(id), &outer = coarser->extent;
  HeightRange range{kHighestRelief_m, kLowestRelief_m};
  const auto steps_up = [](Tick length, Tick step) { return steps_in(length + step - 1, step); };
  for (int r = steps_in(e.lat0 - outer.lat0, outer.lat_step); r <= steps_up(e.lat1() - outer.lat0, outer.lat_step); ++r)
    for (int c = steps_in(e.lon0 - outer.lon0, outer.lon_step); c <= steps_up(e.lon1() - outer.lon0, outer.lon_step);
         ++c) {
      const float height_m = coarser->vertices[coarser->index(r, c)].height_m;
      if (std::isnan(height_m)) return std::nullopt;
      range.low = std::min(range.low, height_m);
      range.high = std::max(range.high, height_m);
    }
  const auto error_m = static_cast<float>(coarser->error_m);
  return HeightRange{range.low - error_m, range.high + error_m};
}

std::optional<BlockId> DetailedTerrain::posts_to_await(const BlockId& id) const {
  if (uses_coarse_posts_only(id)) return std::nullopt;
  return ancestor_of(id, std::min(id.level, plain_->posts_level(id)));
}

std::shared_ptr<const Block> DetailedTerrain::block(const BlockId& id, const StopToken& stop) const {
  constexpr auto kKind = GroundCache::Kind::block;
  if (!has_detail(id)) return plain_->block(id, stop);
  if (const auto hit = cache_.find(kKind, id)) return *hit;
  return cache_.run_in_arena(posts_to_await(id), stop, [&] {
    return cache_.get(kKind, id, stop, [&] { return cache_.read_or_make(id, [&] { return make_block(id, stop); }); });
  });
}

double DetailedTerrain::relief_factor(double lat_deg, double lon_deg, int detail_level, const StopToken& stop) const {
  if (!detail_->relief().follows_posts()) return 1;
  const Ticks ticks = ticks_of(lat_deg, lon_deg);
  const std::int64_t lat = ticks.whole_lat, lon = ticks.whole_lon;
  double factor = 1;
  cache_.run_in_arena(posts_to_await(ticks.block(kMaxLevel)), stop, [&] {
    factor = posts_.relief_factors(detail_level, {&lat, 1}, {&lon, 1}, stop).front();
    return std::shared_ptr<const Block>();
  });
  return factor;
}

std::shared_ptr<const Block> DetailedTerrain::block_or_quad(const BlockId& id, Tick lat, Tick lon,
                                                            const StopToken& stop) const {
  if (!has_detail(id)) return plain_->block(id, stop);
  if (const auto hit = cache_.find(GroundCache::Kind::block, id)) return *hit;
  const BlockExtent e = extent_of(id);
  const auto vertex_before = [](Tick tick, Tick origin, Tick step) { return origin + (tick - origin) / step * step; };
  const BlockExtent quad{vertex_before(lat, e.lat0, e.lat_step), vertex_before(lon, e.lon0, e.lon_step), e.lat_step,
                         e.lon_step, 1};
  return cache_.run_in_arena(posts_to_await(id), stop, [&] { return maker_.heights(id, quad, stop); });
}

// Makes a block's ground, and widens its height range by its error: the range then bounds the finest surface, too.
std::shared_ptr<const Block> DetailedTerrain::make_block(const BlockId& id, const StopToken& stop) const {
  auto block = maker_.block(id, stop);
  if (!block) return nullptr;
  if (id.level >= finest_level(id)) block->error_m = 0;
  block->detail_error_m = block->error_m;
  block->left_out_size_m = left_out_size_m(id);
  // Do not count as detail the posts that the block omits of layers with finer posts.
  if (!uses_coarse_posts_only(id) && layers_.of(id)->back().level > id.level)
    block->detail_error_m = std::max(0.0, block->error_m - plain_->node(id, stop).error_m);
  block->min_m -= static_cast<float>(block->error_m);
  block->max_m += static_cast<float>(block->error_m);
  return block;
}

}  // namespace selenograph::dem
