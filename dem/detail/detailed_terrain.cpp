// A block is made in four steps. Their order keeps its threads from deadlocking.
//
//   block(id) --> cached? --yes--> return
//       | no
//       v
//   plain_->node(..)       (1) wait for the pyramid of the posts, holding no slot: this may take seconds
//       v
//   where_loops_run        (2) take a slot of the task arena
//       v
//   cached(Kind::block)    (3) single flight: the first thread makes the block, the others sleep in their slots
//       v
//   composed_surface ...   (4) parallel loops of the maker, in the arena that it is already in
//
//   thread A: starts the flight  --waits for a slot-->  [slot 1: B asleep] [slot 2: C asleep]
//                  ^                                          |                 |
//                  +------------- wait for A's flight --------+-----------------+      deadlock, if (3) came before (2)
//
// Threads asleep in (3) occupy slots. A maker that started its flight before it had a slot could wait in (4) for a slot
// that such a sleeper holds. As (2) comes before (3), a maker always has a slot, and runs its loops alone if all other
// threads sleep. Loops are isolated (parallel.h): a maker that waits for the end of a loop does not start a task that
// would wait for the maker's own flight. Flights nest in one direction only, so they form no cycle: a block or an
// outline waits for mean_correction, layer_posts and blocks of the plain terrain, and none of these waits for a block.
// The pyramid's builder has an arena of its own: a maker that has to wait for a neighbour's pyramid is slow, not stuck.
#include "dem/detail/detailed_terrain.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <unordered_map>
#include <vector>

#include "dem/base/hash.h"
#include "dem/base/parallel.h"
#include "dem/detail/footprints.h"
#include "dem/detail/mean_correction.h"
#include "dem/grid/degrees.h"
#include "dem/grid/shading_normals.h"
#include "dem/posts/post_patch.h"
#include "dem/posts/post_source.h"
#include "dem/pyramid/block_posts.h"
#include "dem/terrain/block_store.h"

namespace selenograph::dem {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Rounds down to a multiple of a lattice step, which is a power of two.
std::int64_t floor_to(std::int64_t value, std::int64_t step) { return value & -step; }

// Returns weight * value, and 0 for weight 0, where value may be NaN (no data).
double weighted(double weight, double value) { return weight == 0 ? 0 : weight * value; }

// Returns the cache key of an object of this terrain. It uses levels above kMaxLevel: keys of the plain terrain's
// blocks in the same cache cannot collide with it.
BlockId key_of(int number, int kind, const BlockId& id) {
  constexpr int kLevelStride = 32;
  static_assert(kMaxLevel < kLevelStride);
  constexpr int kKinds = 4;
  return {kLevelStride * (kKinds * number + kind) + id.level, id.row, id.col};
}

// Version of the heights in the cache folder, which outlive an update of the software. Increment it with every change
// that alters a stored bit (GroundOnDisk.IsOfThisVersion in unit.block_store).
constexpr std::uint64_t kGroundVersion = 4;

std::uint64_t key_of_ground(const Catalogue& catalogue, const DetailPreset& preset) {
  const std::uint64_t parts[] = {kGroundVersion, catalogue.fingerprint(), preset.fingerprint};
  return hash_of(parts, sizeof parts);
}

std::shared_ptr<Block> empty_block(const BlockId& id, const BlockExtent& extent) {
  auto block = std::make_shared<Block>();
  block->id = id;
  block->extent = extent;
  fill_trigonometry(*block);
  return block;
}

// Returns a block's extent, enlarged by the surrounding posts from which normals and second differences are computed.
BlockExtent with_halo(const BlockExtent& e) {
  return {e.lat0 - kHalo * e.lat_step, e.lon0 - kHalo * e.lon_step, e.lat_step, e.lon_step, e.quads + 2 * kHalo};
}

// Directions of a square grid relative to a block's posts; it may be denser than the posts and extend past the block.
// Rows beyond a pole continue on the opposite meridian, where cos(latitude) is negative.
class BlockDirections {
 public:
  // `first_post` and `post_step`: position of the first row and column, and their spacing, in posts of the extent.
  BlockDirections(const BlockExtent& extent, double first_post, double post_step, int side) {
    const auto n = static_cast<std::size_t>(side);
    for (auto& table : tables_) table.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      const double post = first_post + static_cast<double>(i) * post_step;
      // Ticks convert to degrees without rounding, so both sides of the date line get the same bits.
      const auto [sin_lat, cos_lat] =
          sine_cosine_of_deg(-90 + (extent.lat0 + post * extent.lat_step) / kTicksPerDegree);
      const auto [sin_lon, cos_lon] =
          sine_cosine_of_deg(-180 + (extent.lon0 + post * extent.lon_step) / kTicksPerDegree);
      tables_[0][i] = sin_lat;
      tables_[1][i] = cos_lat;
      tables_[2][i] = sin_lon;
      tables_[3][i] = cos_lon;
    }
    constexpr double kRadiansPerTick = kRadiansPerDegree / kTicksPerDegree;
    west_ = -std::numbers::pi + kRadiansPerTick * (extent.lon0 + first_post * extent.lon_step);
    step_ = kRadiansPerTick * post_step * extent.lon_step;
  }
  DirectionGrid grid() const { return {tables_[0], tables_[1], tables_[2], tables_[3], west_, step_}; }

 private:
  std::array<std::vector<double>, 4> tables_;
  double west_ = 0, step_ = 0;
};

}  // namespace

// 16 x 16 quads of a block of posts, the unit in which mean corrections are made: a lander sees few posts, and a whole
// block would correct many that it never uses.
//
//   +----+----+----+----+
//   |3,0 |    |    |3,3 |     block of 64 x 64 quads, sub-blocks by (north, east)
//   +----+----+----+----+
//   |    |    |    |    |     posts on a common edge belong to both sub-blocks;
//   +----+----+----+----+     SubBlock::of chooses the northern and eastern one
//   |0,0 |0,1 |    |0,3 |
//   +----+----+----+----+
struct DetailedTerrain::SubBlock {
  BlockId block;
  int north = 0, east = 0;  // index from the south and from the west

  static constexpr int kMaxPerSide = 4;
  // Returns the sub-block of the post in row `r` and column `c` of the block.
  static SubBlock of(const BlockId& block, int r, int c) {
    const SubBlock first{block};
    return {block, std::min(r / first.quads(), first.per_side() - 1),
            std::min(c / first.quads(), first.per_side() - 1)};
  }
  int per_side() const { return std::min(kMaxPerSide, quads_per_side(block.level)); }
  int quads() const { return quads_per_side(block.level) / per_side(); }
  BlockExtent extent() const {
    const BlockExtent e = extent_of(block);
    return {e.lat0 + north * quads() * e.lat_step, e.lon0 + east * quads() * e.lon_step, e.lat_step, e.lon_step,
            quads()};
  }
  BlockId key() const { return {block.level, kMaxPerSide * block.row + north, kMaxPerSide * block.col + east}; }
};

// Interpolates posts of one level at positions in ticks, across block borders, the poles and the date line. Holds the
// blocks that it has read. For one thread.
class DetailedTerrain::PostReader {
 public:
  // A layer's own posts; posts of the pyramid's blocks; corrections of the posts' means (mean_correction.h).
  enum class Posts { of_layer, filtered, mean_correction };
  PostReader(const DetailedTerrain& ground, int level, Posts posts, const StopToken& stop)
      : ground_(ground), level_(level), posts_(posts), stop_(stop) {}

  std::int32_t lat_step() const { return 1 << (kTickLevel - level_); }

  // Returns the height on a row of posts, interpolated along it: cubic between four posts, linear beside a void. `lat`
  // is a multiple of lat_step() and may lie beyond a pole.
  double height_on_row(std::int64_t lat, std::int64_t lon) {
    std::int64_t lon_offset = 0;
    if (lat < 0 || lat > kLatTicks) {
      lat = lat < 0 ? -lat : 2 * std::int64_t{kLatTicks} - lat;
      lon_offset = kLonTicks / 2;
    }
    const auto row_lat = static_cast<std::int32_t>(lat);
    const std::int32_t step = lon_step(row_lat);
    const std::int64_t lon_tick = std::int64_t{wrap_lon(lon + lon_offset)}, first = floor_to(lon_tick, step);
    if (first == lon_tick) return post_m(row_lat, lon_tick);
    const double t = static_cast<double>(lon_tick - first) / step;
    const std::array<double, 4> w = cubic_weights(t);
    if (row_lat != cached_quad_lat_ || first != cached_quad_lon_) {
      for (int i = 0; i < 4; ++i)
        cached_posts_m_[static_cast<std::size_t>(i)] = post_m(row_lat, first + (i - 1) * std::int64_t{step});
      cached_quad_lat_ = row_lat;
      cached_quad_lon_ = first;
    }
    double sum = 0;
    for (std::size_t i = 0; i < 4; ++i) sum += w[i] * cached_posts_m_[i];
    if (!std::isnan(sum)) return sum;
    return (1 - t) * cached_posts_m_[1] + t * cached_posts_m_[2];
  }

  // Interpolates the heights of a circle of latitude at the given longitudes: bicubic, linear beside a void. All calls
  // of one reader must pass the same longitudes, because rows of posts are cached.
  void interpolate_row(std::int64_t lat, std::span<const std::int64_t> lons, double* out) {
    const std::int64_t step = lat_step(), first = floor_to(lat, step);
    const std::size_t n = lons.size();
    if (first == lat) {
      const std::vector<double>& on_posts = heights_on_row(lat, lons);
      std::copy(on_posts.begin(), on_posts.end(), out);
      return;
    }
    const double t = static_cast<double>(lat - first) / static_cast<double>(step);
    const std::array<double, 4> w = cubic_weights(t);
    std::array<const double*, 4> rows{};
    for (int i = 0; i < 4; ++i) rows[static_cast<std::size_t>(i)] = heights_on_row(first + (i - 1) * step, lons).data();
    for (std::size_t c = 0; c < n; ++c) {
      double sum = 0;
      for (std::size_t i = 0; i < 4; ++i) sum += w[i] * rows[i][c];
      out[c] = std::isnan(sum) ? weighted(1 - t, rows[1][c]) + weighted(t, rows[2][c]) : sum;
    }
  }

  // Appends the sources of the posts nearest to a circle of latitude at the given longitudes. Most rows have the same
  // nearest posts as the row before: copy its sources then.
  void append_sources(std::int64_t lat, std::span<const std::int64_t> lons, std::vector<SourceMark>& out) {
    const std::int64_t nearest = std::clamp<std::int64_t>(floor_to(lat + lat_step() / 2, lat_step()), 0, kLatTicks);
    const std::size_t n = lons.size(), before = out.size();
    for (std::size_t c = 0; c < n; ++c)
      out.push_back(nearest == last_source_lat_ ? out[before - n + c]
                                                : source(static_cast<std::int32_t>(nearest), lons[c]));
    last_source_lat_ = nearest;
  }

 private:
  SourceMark source(std::int32_t row_lat, std::int64_t lon) {
    const std::int32_t step = lon_step(row_lat);
    const std::int64_t nearest_lon = floor_to(std::int64_t{wrap_lon(lon)} + step / 2, step);
    if (row_lat == marked_lat_ && nearest_lon == marked_lon_) return mark_;
    const PostRef p = find_post(row_lat, nearest_lon);
    marked_lat_ = row_lat;
    marked_lon_ = nearest_lon;
    return mark_ = p.block ? p.block->source(p.r, p.c) : kNoSource;
  }

  struct PostRef {
    const Block* block = nullptr;
    int r = 0, c = 0;
  };

  // Returns the heights on a row of posts. They are cached: interpolate_row needs the same rows again for all rows
  // between two rows of posts.
  const std::vector<double>& heights_on_row(std::int64_t lat, std::span<const std::int64_t> lons) {
    const auto [found, is_new] = rows_.try_emplace(lat);
    std::vector<double>& out = found->second;
    if (is_new)
      for (const std::int64_t lon : lons) out.push_back(height_on_row(lat, lon));
    return out;
  }

  // Returns the spacing of posts along a row. A row on the border of two rows of blocks with different spacing uses the
  // larger one, whose posts both have.
  std::int32_t lon_step(std::int32_t lat) {
    if (lat == cached_step_lat_) return lon_step_;
    const auto step_at = [&](std::int32_t block_lat) {
      const BlockId id = block_at(level_, block_lat, 0);
      return lat_step() << lon_shift(level_, id.row);
    };
    cached_step_lat_ = lat;
    return lon_step_ =
               std::max(step_at(std::clamp(lat, 0, kLatTicks - 1)), step_at(std::clamp(lat - 1, 0, kLatTicks - 1)));
  }

  PostRef find_post(std::int32_t lat, std::int64_t lon) {
    const std::int32_t wrapped = wrap_lon(lon);
    // A block's last row is the first row of the block to the north. The pole has no block to the north.
    BlockId id = block_at(level_, std::min(lat, kLatTicks - 1), wrapped);
    PostRef p = post_in_block(id, lat, wrapped);
    // If the block to the north has no posts, take the row from the block to the south.
    if (p.block || lat == 0) return p;
    return post_in_block(block_at(level_, lat - 1, wrapped), lat, wrapped);
  }

  PostRef post_in_block(const BlockId& id, std::int32_t lat, std::int32_t lon) {
    const Block* block =
        posts_ == Posts::mean_correction ? correction_at(id, lat, lon) : find_block(id, [&] { return load_block(id); });
    if (!block) return {};
    const BlockExtent& e = block->extent;
    return {block, (lat - e.lat0) / e.lat_step, (lon - e.lon0) / e.lon_step};
  }

  double post_m(std::int32_t lat, std::int64_t lon) {
    const PostRef p = find_post(lat, lon);
    return p.block ? static_cast<double>(p.block->vertices[p.block->index(p.r, p.c)].height_m) : kNaN;
  }

  const Block* correction_at(const BlockId& id, std::int32_t lat, std::int32_t lon) {
    const BlockExtent e = extent_of(id);
    const SubBlock sub_block = SubBlock::of(id, (lat - e.lat0) / e.lat_step, (lon - e.lon0) / e.lon_step);
    return find_block(sub_block.key(), [&] { return ground_.mean_correction(sub_block, stop_); });
  }

  template <typename Make>
  const Block* find_block(const BlockId& key, const Make& make) {
    if (latest_ && latest_id_ == key) return latest_;
    auto found = blocks_.find(key);
    if (found == blocks_.end()) found = blocks_.emplace(key, make()).first;
    latest_id_ = key;
    latest_ = found->second.get();
    return latest_;
  }

  std::shared_ptr<const Block> load_block(const BlockId& id) const {
    return posts_ == Posts::of_layer ? ground_.posts_of_layer(id, stop_) : ground_.plain_->block(id, stop_);
  }

  const DetailedTerrain& ground_;
  int level_;
  Posts posts_;
  const StopToken& stop_;
  std::unordered_map<BlockId, std::shared_ptr<const Block>, BlockIdHash> blocks_;
  // The latest result of each lookup: neighbouring positions repeat them.
  BlockId latest_id_;
  const Block* latest_ = nullptr;
  std::unordered_map<std::int64_t, std::vector<double>> rows_;  // heights_on_row, by latitude in ticks
  std::int32_t cached_step_lat_ = -1, lon_step_ = 0;
  std::int32_t cached_quad_lat_ = -1;
  std::int64_t cached_quad_lon_ = -1;
  std::array<double, 4> cached_posts_m_{};
  std::int64_t last_source_lat_ = -1;
  std::int32_t marked_lat_ = -1;
  std::int64_t marked_lon_ = -1;
  SourceMark mark_ = kNoSource;
};

DetailedTerrain::DetailedTerrain(std::shared_ptr<const PyramidTerrain> plain, std::shared_ptr<const Detail> detail)
    : plain_(std::move(plain)),
      detail_(std::move(detail)),
      number_(plain_->new_detail_number()),
      key_(key_of_ground(plain_->catalogue(), detail_->preset())),
      layers_(*plain_, detail_->widest_m()) {}

// Ask for the block of posts above this one: a small block may lie in the gap between the last posts of a file and the
// first of the next, where the terrain has a surface but no post.
bool DetailedTerrain::has_data(const BlockId& id) const {
  return plain_->has_data(ancestor_of(id, std::min(id.level, plain_->posts_level(id))));
}

bool DetailedTerrain::detail_reaches(const BlockId& id) const {
  if (detail_->preset().region.everywhere()) return true;
  const BlockId of_posts = ancestor_of(id, std::min(id.level, plain_->posts_level(id)));
  const Circle circle = circle_around(footprint_of(of_posts));
  // A descendant's circle may stick out of its ancestor's. The mean correction reaches some posts beyond the detail.
  constexpr double kMarginFactor = 1.01, kMarginPosts = 4;
  const int level = std::min(of_posts.level, layers_.coarsest_detail(id));
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

NodeInfo DetailedTerrain::node(const BlockId& id, const StopToken& stop) const {
  const auto info_of = [](const Block& b) {
    return NodeInfo{b.error_m, b.min_m, b.max_m, false, {}, b.detail_error_m, b.left_out_size_m};
  };
  // Only unusable files make the plain terrain's node necessary. Skip it otherwise: a frame calls this for thousands of
  // blocks.
  const bool files_usable = !plain_->has_replacements();
  if (files_usable)
    if (const auto hit = plain_->blocks().find(key_of(number_, static_cast<int>(Kind::block), id)); hit && *hit)
      return info_of(**hit);
  if (has_detail(id)) {
    const auto detailed = block(id, stop);
    if (!detailed) return {};
    NodeInfo info = info_of(*detailed);
    if (!files_usable || !uses_coarse_posts_only(id)) info.replaced = plain_->node(id, stop).replaced;
    return info;
  }
  NodeInfo info = plain_->node(id, stop);
  if (info.empty || !detail_reaches(id)) return info;
  const int posts = layers_.coarsest(id);
  // The surface curves between the posts by about as much as posts deviate from the surface through every second one:
  // take that level's error as the bound. For much coarser levels take half of their own error. It is larger than the
  // bend, since rough ground is rougher over longer distances.
  constexpr int kMuchCoarser = 3;
  double bend = 0;
  if (id.level + kMuchCoarser <= posts)
    bend = info.error_m / 2;
  else if (posts > 0)
    bend = id.level < posts ? info.error_m : plain_->node(ancestor_of(id, posts - 1), stop).error_m;
  const double detail_error_m = bend + detail_->max_detail_m(layers_.coarsest_detail(id));
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
  const int finer = id.level - layer.level;
  if (layers->size() > 1 || finer <= 0) return std::nullopt;
  const int past = finer - kLevelsFromPosts - 1;  // levels past the first one that is made; negative: bounds from posts
  if (past >= 0 && past % kLevelsApart == 0) return std::nullopt;
  const auto heights =
      past < 0 ? bounds_from_posts(id, layer, stop) : bounds_from_ancestor(id, id.level - past % kLevelsApart, stop);
  if (!heights) return std::nullopt;
  NodeInfo info{detail_->left_out_m(id.level, layer.detail_level), heights->low, heights->high, false, {}};
  info.detail_error_m = info.error_m;
  info.left_out_size_m = left_out_size_m(id);
  return info;
}

std::optional<HeightRange> DetailedTerrain::bounds_from_posts(const BlockId& id, const LayeredPosts::Layer& layer,
                                                              const StopToken& stop) const {
  auto outline = plain_->blocks().find(key_of(number_, static_cast<int>(Kind::outline), id));
  if (!outline)
    outline = make_in_arena(
        id, stop, [&] { return cached(Kind::outline, id, stop, [&] { return make_posts_outline(id, layer, stop); }); });
  if (!*outline) return std::nullopt;
  return HeightRange{(*outline)->min_m, (*outline)->max_m};
}

std::shared_ptr<const Block> DetailedTerrain::make_posts_outline(const BlockId& id, const LayeredPosts::Layer& layer,
                                                                 const StopToken& stop) const {
  const BlockExtent e = extent_of(id), of_posts = extent_of(ancestor_of(id, layer.level));
  PostReader posts(*this, layer.level, PostReader::Posts::of_layer, stop);
  HeightRange range{kHighestRelief_m, kLowestRelief_m};
  // Interpolation at a position uses one post before the position's quad and one after it.
  const auto first = [](std::int64_t tick, std::int64_t step) { return floor_to(tick, step) - step; };
  for (std::int64_t lat = first(e.lat0, of_posts.lat_step); lat <= e.lat1() + 2 * of_posts.lat_step;
       lat += of_posts.lat_step)
    for (std::int64_t lon = first(e.lon0, of_posts.lon_step); lon <= e.lon1() + 2 * of_posts.lon_step;
         lon += of_posts.lon_step) {
      const auto height_m = static_cast<float>(posts.height_on_row(lat, lon));
      if (std::isnan(height_m)) return nullptr;
      range.low = std::min(range.low, height_m);
      range.high = std::max(range.high, height_m);
    }
  // Catmull-Rom overshoots by 0.28 of the range. Next to a row whose posts are twice as far apart, the heights above
  // are themselves interpolated along the row and may overshoot, too.
  constexpr float kOvershoot = 0.6F;
  const float margin_m =
      kOvershoot * (range.high - range.low) + static_cast<float>(detail_->max_detail_m(layer.detail_level));
  auto outline = std::make_shared<Block>();
  outline->id = id;
  outline->min_m = range.low - margin_m;
  outline->max_m = range.high + margin_m;
  return outline;
}

std::optional<HeightRange> DetailedTerrain::bounds_from_ancestor(const BlockId& id, int level,
                                                                 const StopToken& stop) const {
  const auto coarser = block(ancestor_of(id, level), stop);
  if (!coarser) return std::nullopt;
  const BlockExtent e = extent_of(id), &outer = coarser->extent;
  HeightRange range{kHighestRelief_m, kLowestRelief_m};
  const auto steps_up = [](std::int32_t length, std::int32_t step) { return (length + step - 1) / step; };
  for (int r = (e.lat0 - outer.lat0) / outer.lat_step; r <= steps_up(e.lat1() - outer.lat0, outer.lat_step); ++r)
    for (int c = (e.lon0 - outer.lon0) / outer.lon_step; c <= steps_up(e.lon1() - outer.lon0, outer.lon_step); ++c) {
      const float height_m = coarser->vertices[coarser->index(r, c)].height_m;
      if (std::isnan(height_m)) return std::nullopt;
      range.low = std::min(range.low, height_m);
      range.high = std::max(range.high, height_m);
    }
  const auto error_m = static_cast<float>(coarser->error_m);
  return HeightRange{range.low - error_m, range.high + error_m};
}

std::shared_ptr<const Block> DetailedTerrain::block(const BlockId& id, const StopToken& stop) const {
  return cached_block_or(id, stop,
                         [&] { return cached(Kind::block, id, stop, [&] { return read_or_make_block(id, stop); }); });
}

std::shared_ptr<const Block> DetailedTerrain::block_or_quad(const BlockId& id, std::int32_t lat, std::int32_t lon,
                                                            const StopToken& stop) const {
  const BlockExtent e = extent_of(id);
  return cached_block_or(id, stop, [&] {
    const auto first = [](std::int32_t tick, std::int32_t origin, std::int32_t step) {
      return origin + (tick - origin) / step * step;
    };
    return make_quad(id, {first(lat, e.lat0, e.lat_step), first(lon, e.lon0, e.lon_step), e.lat_step, e.lon_step, 1},
                     stop);
  });
}

template <typename Make>
std::shared_ptr<const Block> DetailedTerrain::cached_block_or(const BlockId& id, const StopToken& stop,
                                                              const Make& make) const {
  if (!has_detail(id)) return plain_->block(id, stop);
  if (const auto hit = plain_->blocks().find(key_of(number_, static_cast<int>(Kind::block), id))) return *hit;
  return make_in_arena(id, stop, make);
}

template <typename Make>
std::shared_ptr<const Block> DetailedTerrain::make_in_arena(const BlockId& id, const StopToken& stop,
                                                            const Make& make) const {
  // First wait for the pyramid outside the arena, then enter the arena, then start the flight in make(): any other
  // order can deadlock (drawing at the top of this file).
  if (!uses_coarse_posts_only(id)) plain_->node(ancestor_of(id, std::min(id.level, plain_->posts_level(id))), stop);
  std::shared_ptr<const Block> block;
  where_loops_run([&] { block = make(); });
  return block;
}

template <typename Make>
std::shared_ptr<const Block> DetailedTerrain::cached(Kind kind, const BlockId& id, const StopToken& stop,
                                                     const Make& make) const {
  return plain_->blocks().get(
      key_of(number_, static_cast<int>(kind), id),
      [&] {
        std::shared_ptr<const Block> value = make();
        const std::size_t bytes = value ? value->bytes() : sizeof(Block);
        return BlockCache::Loaded{std::move(value), bytes};
      },
      stop);
}

std::shared_ptr<const Block> DetailedTerrain::posts_of_layer(const BlockId& id, const StopToken& stop) const {
  // The pyramid has unfiltered posts only at their own level. Its coarser blocks are means of finer posts.
  if (id.level == plain_->posts_level(id)) return plain_->block(id, stop);
  return cached(Kind::layer_posts, id, stop, [&] { return compose_layer_posts(id, stop); });
}

std::shared_ptr<const Block> DetailedTerrain::mean_correction(const SubBlock& sub_block, const StopToken& stop) const {
  return cached(Kind::mean_correction, sub_block.key(), stop, [&] { return make_mean_correction(sub_block, stop); });
}

std::shared_ptr<Block> DetailedTerrain::compose_layer_posts(const BlockId& id, const StopToken& stop) const {
  const BlockId root = id.level <= kRootLevel ? id : ancestor_of(id, kRootLevel);
  PostsOfBlock posts = compose_block(root, id, plain_->post_source(), layers_.files_up_to(id.level), stop);
  auto block = empty_block(id, extent_of(id));
  const int side = block->side(), wide = side + 2 * kHalo;
  bool any = false;
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c) {
      const float height_m = posts.heights[static_cast<std::size_t>((r + kHalo) * wide + c + kHalo)];
      block->vertices.push_back({height_m, Eigen::Vector3f::Zero()});
      any |= !std::isnan(height_m);
    }
  if (!any) return nullptr;
  block->sources = std::move(posts.sources);
  block->pack();
  return block;
}

std::shared_ptr<Block> DetailedTerrain::make_mean_correction(const SubBlock& sub_block, const StopToken& stop) const {
  const BlockExtent e = sub_block.extent();
  const auto side = static_cast<std::size_t>(e.quads + 1 + 2 * kCellsAround);
  const std::vector<double> out = sharpened(cell_means(sub_block, kCellsAround, stop), side);
  auto block = empty_block(sub_block.block, e);
  block->vertices.reserve(block->index(e.quads, e.quads) + 1);
  for (int r = 0; r <= e.quads; ++r) {
    const double weight = correction_weight(e.lat0 + r * e.lat_step, e.lat_step);
    for (int c = 0; c <= e.quads; ++c) {
      const std::size_t at =
          static_cast<std::size_t>(r + kCellsAround) * side + static_cast<std::size_t>(c + kCellsAround);
      block->vertices.push_back({static_cast<float>(weight * out[at]), Eigen::Vector3f::Zero()});
    }
  }
  return block;
}

// A cell is centred at its post and as wide as the posts' spacing. Each octave is sampled at n x n positions per cell:
//
//   +-------+-------+
//   | . . . | . . . |     x  post, centre of its cell
//   | . x . | . x . |     .  samples (n = 3 here; 8 or more, by the octave)
//   | . . . | . . . |     means of octaves add up to the cell's mean
//   +-------+-------+
//
// The sampling grid is laid out for the whole block, so that a cell's mean is the same to the bit in every sub-block
// that includes the cell.
std::vector<double> DetailedTerrain::cell_means(const SubBlock& sub_block, int margin, const StopToken& stop) const {
  const BlockExtent e = extent_of(sub_block.block);
  const auto cells = static_cast<std::size_t>(sub_block.quads() + 1 + 2 * margin);
  std::vector<double> means(cells * cells);
  for (int octave = Detail::smallest_octave(sub_block.block.level + Detail::kCellLevels);
       octave < Detail::past_largest_octave(sub_block.block.level); ++octave) {
    const int samples = Detail::samples_per_cell(octave, sub_block.block.level);
    const auto n = static_cast<std::size_t>(samples);
    const BlockDirections directions(e, 0.5 / samples - 0.5 - margin, 1.0 / samples,
                                     (e.quads + 1 + 2 * margin) * samples);
    const auto first = [&](int index) { return static_cast<std::size_t>(index * sub_block.quads()) * n; };
    // Work in squares of cells, whose samples fit in the processor's caches.
    constexpr std::size_t kSquare = 9;
    const std::size_t squares = (cells + kSquare - 1) / kSquare;
    in_parallel(squares * squares, [&](std::size_t i) {
      const std::size_t r0 = i / squares * kSquare, c0 = i % squares * kSquare;
      const std::size_t rows = std::min(kSquare, cells - r0), columns = std::min(kSquare, cells - c0);
      std::vector<double> heights(rows * n * columns * n);
      detail_->add_octave(sub_grid(directions.grid(), first(sub_block.north) + r0 * n, rows * n,
                                   first(sub_block.east) + c0 * n, columns * n),
                          octave, heights, stop);
      const double* height_m = heights.data();
      for (std::size_t r = r0 * n; r < (r0 + rows) * n; ++r)
        for (std::size_t c = c0; c < c0 + columns; ++c)
          for (std::size_t k = 0; k < n; ++k) means[r / n * cells + c] += *height_m++ / (samples * samples);
    });
  }
  return means;
}

// Heights at the posts of an extent, row by row.
struct DetailedTerrain::Surface {
  std::vector<double> posts_m, heights_m;  // without detail, with it
  std::vector<float> in_crater;            // 1 inside a crater's rim, else 0
  std::vector<SourceMark> sources;
  std::vector<Ground> ground;  // shown outside craters
  double left_out_m;           // bound on the detail that finer levels add
};

DetailedTerrain::Surface DetailedTerrain::layer_surface(const BlockId& id, const BlockExtent& e,
                                                        const LayeredPosts::Layer& layer, const StopToken& stop) const {
  const int side = e.quads + 1;
  const auto n = static_cast<std::size_t>(side);
  const bool finer = id.level > layer.level, shown = id.level > layer.detail_level;
  PostReader posts(*this, finer ? layer.level : id.level,
                   finer ? PostReader::Posts::of_layer : PostReader::Posts::filtered, stop);
  PostReader correction(*this, layer.detail_level, PostReader::Posts::mean_correction, stop);
  Surface out{{}, std::vector<double>(n * n), std::vector<float>(n * n), {}, {}, 0};
  out.sources.reserve(n * n);
  std::vector<std::int64_t> lons;
  lons.reserve(n);
  for (int i = 0; i < side; ++i) lons.push_back(e.lon0 + std::int64_t{i} * e.lon_step);
  std::vector<double> correction_m(n);
  for (int r = 0; r < side; ++r) {
    stop.check();
    const std::int64_t lat = e.lat0 + std::int64_t{r} * e.lat_step;
    double* const row_m = out.heights_m.data() + static_cast<std::size_t>(r) * n;
    posts.interpolate_row(lat, lons, row_m);
    posts.append_sources(lat, lons, out.sources);
    if (!shown) continue;
    correction.interpolate_row(lat, lons, correction_m.data());
    for (std::size_t c = 0; c < n; ++c) row_m[c] -= correction_m[c];
  }
  out.posts_m = out.heights_m;
  if (!finer) out.left_out_m = plain_->node(id, stop).error_m;
  out.ground.assign(n * n, shown && detail_->has_relief(id.level, layer.detail_level) ? Ground::relief : Ground::dem);
  if (!shown) return out;
  detail_->add(BlockDirections(e, 0, 1, side).grid(), id.level, layer.detail_level, out.heights_m, out.in_crater, stop);
  // A level coarser than the posts omits, besides posts, the bicubic curve between them: double the plain error for it.
  out.left_out_m = 2 * out.left_out_m + detail_->left_out_m(id.level, layer.detail_level);
  return out;
}

// Blends a layer's ground over that of the coarser layers, by the layer's share at each post.
void DetailedTerrain::blend(Surface& below, const Surface& above, const BlockExtent& e,
                            const LayeredPosts::Layer& layer) const {
  const int side = e.quads + 1;
  // Return one side's exact bits at shares 0 and 1: blocks outside the band evaluate one layer only and must agree.
  const auto mixed = [](double share, double a, double b) {
    return share == 0 ? a : share == 1 ? b : a + share * (b - a);
  };
  std::size_t at = 0;
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c, ++at) {
      double lat_deg = lat_deg_of(e.lat0 + r * e.lat_step), lon_deg = lon_deg_of(e.lon0 + c * e.lon_step);
      if (std::abs(lat_deg) > 90) {
        lat_deg = std::copysign(180, lat_deg) - lat_deg;
        lon_deg += 180;
      }
      const double share = layers_.share(layer, lat_deg, lon_deg);
      if (share == 0) continue;
      double &posts_m = below.posts_m[at], &height_m = below.heights_m[at];
      const double added_m = mixed(share, height_m - posts_m, above.heights_m[at] - above.posts_m[at]);
      posts_m = mixed(share, posts_m, above.posts_m[at]);
      height_m = share == 1 ? above.heights_m[at] : posts_m + added_m;
      if (share <= 0.5) continue;
      below.sources[at] = above.sources[at];
      below.in_crater[at] = above.in_crater[at];
      below.ground[at] = above.ground[at];
    }
  below.left_out_m = std::max(below.left_out_m, above.left_out_m);
}

DetailedTerrain::Surface DetailedTerrain::composed_surface(const BlockId& id, const BlockExtent& e,
                                                           const StopToken& stop) const {
  const LayeredPosts::Layers layers = layers_.of(id);
  Surface surface = layer_surface(id, e, layers->front(), stop);
  for (auto layer = layers->begin() + 1; layer != layers->end(); ++layer)
    blend(surface, layer_surface(id, e, *layer, stop), e, *layer);
  return surface;
}

std::shared_ptr<const Block> DetailedTerrain::make_quad(const BlockId& id, const BlockExtent& e,
                                                        const StopToken& stop) const {
  auto block = empty_block(id, e);
  for (const double height_m : composed_surface(id, e, stop).heights_m)
    block->vertices.push_back({static_cast<float>(height_m), Eigen::Vector3f::Zero()});
  return block;
}

std::shared_ptr<const Block> DetailedTerrain::read_or_make_block(const BlockId& id, const StopToken& stop) const {
  BlockStore* const store = plain_->block_store();
  // Bypass the cache folder while a coarser layer replaces an unusable file: the ground differs until it is repaired.
  if (!store || detail_->preset().fingerprint == 0 || plain_->has_replacements()) return make_block(id, stop);
  if (auto block = store->read(key_, id)) return block;
  auto block = make_block(id, stop);
  if (block && !plain_->has_replacements()) store->write(key_, *block);
  return block;
}

std::shared_ptr<const Block> DetailedTerrain::make_block(const BlockId& id, const StopToken& stop) const {
  auto block = empty_block(id, extent_of(id));
  const BlockExtent& e = block->extent;
  const auto n = static_cast<std::size_t>(e.quads + 1 + 2 * kHalo);
  const Surface surface = composed_surface(id, with_halo(e), stop);
  const bool everywhere = detail_->preset().region.everywhere();

  std::vector<float> rounded(surface.heights_m.begin(), surface.heights_m.end());
  block->vertices.reserve(block->index(e.quads, e.quads) + 1);
  block->sources.reserve(block->index(e.quads, e.quads) + 1);
  block->ground.reserve(block->index(e.quads, e.quads) + 1);
  float low = kHighestRelief_m, high = kLowestRelief_m;
  double bend = 0;
  for (int r = 0; r <= e.quads; ++r)
    for (int c = 0; c <= e.quads; ++c) {
      const std::size_t at = static_cast<std::size_t>(r + kHalo) * n + static_cast<std::size_t>(c + kHalo);
      const float* h = rounded.data() + at;
      block->vertices.push_back({*h, Eigen::Vector3f::Zero()});
      block->sources.push_back(surface.sources[at]);
      const bool outside = !everywhere && detail_->share(block->position(r, c, 0).normalized()) == 0;
      block->ground.push_back(surface.in_crater[at] > 0 ? Ground::crater : outside ? Ground::dem : surface.ground[at]);
      if (std::isnan(*h)) continue;
      low = std::min(low, *h);
      high = std::max(high, *h);
      for (const std::ptrdiff_t step : {std::ptrdiff_t{1}, static_cast<std::ptrdiff_t>(n)})
        if (const float second = h[step] - 2 * *h + h[-step]; !std::isnan(second))
          bend = std::max(bend, static_cast<double>(std::abs(second)));
    }
  if (low > high) return nullptr;
  block->pack();
  // A kink between two posts deviates from their chord by at most half the nearer post's second difference. Along two
  // axes, three quarters exceed every error that unit.detail has measured.
  block->error_m = id.level >= finest_level(id) ? 0 : 0.75 * bend + surface.left_out_m;
  block->detail_error_m = block->error_m;
  block->left_out_size_m = left_out_size_m(id);
  // Do not count as detail the posts that the block omits of layers with finer posts.
  if (!uses_coarse_posts_only(id) && layers_.of(id)->back().level > id.level)
    block->detail_error_m = std::max(0.0, block->error_m - plain_->node(id, stop).error_m);
  block->min_m = low - static_cast<float>(block->error_m);
  block->max_m = high + static_cast<float>(block->error_m);
  fill_shading_normals(*block, rounded, {});
  return block;
}

}  // namespace selenograph::dem
