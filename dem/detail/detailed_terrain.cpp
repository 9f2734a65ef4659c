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
#include "dem/detail/means_taken.h"
#include "dem/grid/degrees.h"
#include "dem/grid/shading_normals.h"
#include "dem/posts/cubic.h"
#include "dem/posts/post_source.h"
#include "dem/pyramid/block_posts.h"
#include "dem/terrain/block_store.h"

namespace selenograph::dem {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Steps of the lattice are powers of two.
std::int64_t floor_to(std::int64_t value, std::int64_t step) { return value & -step; }

// Weighted without those that weigh nothing, which may be voids.
double weighted(double weight, double value) { return weight == 0 ? 0 : weight * value; }

// Levels that there are none of: the plain terrain's blocks are kept under their own.
BlockId key_of(int number, int kind, const BlockId& id) {
  constexpr int kManyLevels = 32;
  static_assert(kMaxLevel < kManyLevels);
  constexpr int kKinds = 4;
  return {kManyLevels * (kKinds * number + kind) + id.level, id.row, id.col};
}

// Blocks are kept in the cache folder from one version of the software to the next: whatever changes a digit of them
// counts one up here (GroundOnDisk.IsOfThisVersion in unit.block_store).
constexpr std::uint64_t kGroundVersion = 4;

std::uint64_t key_of_ground(const Catalogue& catalogue, const DetailPreset& preset) {
  const std::uint64_t parts[] = {kGroundVersion, catalogue.fingerprint(), preset.fingerprint};
  return hash_of(parts, sizeof parts);
}

std::shared_ptr<Block> empty_block(const BlockId& id, const BlockExtent& extent) {
  auto block = std::make_shared<Block>();
  block->id = id, block->extent = extent;
  fill_trigonometry(*block);
  return block;
}

// A block's posts and those beside them that normals and bends are made of.
BlockExtent with_halo(const BlockExtent& e) {
  return {e.lat0 - kHalo * e.lat_step, e.lon0 - kHalo * e.lon_step, e.lat_step, e.lon_step, e.quads + 2 * kHalo};
}

// A block's places by rows and columns from its first post on: between the posts, beside them, beyond the block. Past a
// pole rows go on on the other side of the Moon, where the cosine of the latitude is negative.
class Places {
 public:
  Places(const BlockExtent& extent, double first_post, double posts_apart, int side) {
    const auto n = static_cast<std::size_t>(side);
    for (auto& table : tables_) table.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      const double post = first_post + static_cast<double>(i) * posts_apart;
      // Degrees of ticks are exact, and so is their reduction: the same bits from either side of the date line.
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
    step_ = kRadiansPerTick * posts_apart * extent.lon_step;
  }
  DirectionGrid grid() const { return {tables_[0], tables_[1], tables_[2], tables_[3], west_, step_}; }

 private:
  std::array<std::vector<double>, 4> tables_;
  double west_ = 0, step_ = 0;
};

}  // namespace

struct DetailedTerrain::Part {
  BlockId block;
  int north = 0, east = 0;  // parts south and west of it

  static constexpr int kAlong = 4;
  // Of the post in this row and column of the block.
  static Part of(const BlockId& block, int r, int c) {
    const Part first{block};
    return {block, std::min(r / first.quads(), first.along() - 1), std::min(c / first.quads(), first.along() - 1)};
  }
  int along() const { return std::min(kAlong, quads_per_side(block.level)); }
  int quads() const { return quads_per_side(block.level) / along(); }
  BlockExtent extent() const {
    const BlockExtent e = extent_of(block);
    return {e.lat0 + north * quads() * e.lat_step, e.lon0 + east * quads() * e.lon_step, e.lat_step, e.lon_step,
            quads()};
  }
  BlockId key() const { return {block.level, kAlong * block.row + north, kAlong * block.col + east}; }
};

// Posts of one level, by their ticks, wherever they are: over the poles and around the globe.
class DetailedTerrain::PostsAround {
 public:
  // A layer's own; those of a pyramid's blocks; what is taken from posts for detail.
  enum class Posts { of_layer, filtered, taken };
  PostsAround(const DetailedTerrain& ground, int level, Posts posts, const StopToken& stop)
      : ground_(ground), level_(level), posts_(posts), stop_(stop) {}

  std::int32_t lat_step() const { return 1 << (kTickLevel - level_); }

  // Between the posts of a row of the lattice, along it.
  double along_row(std::int64_t lat, std::int64_t lon) {
    std::int64_t over = 0;
    if (lat < 0 || lat > kLatTicks) lat = lat < 0 ? -lat : 2 * std::int64_t{kLatTicks} - lat, over = kLonTicks / 2;
    const auto row_lat = static_cast<std::int32_t>(lat);
    const std::int32_t step = lon_step(row_lat);
    const std::int64_t place = std::int64_t{wrap_lon(lon + over)}, first = floor_to(place, step);
    if (first == place) return post(row_lat, place);
    const double t = static_cast<double>(place - first) / step;
    const std::array<double, 4> w = cubic_weights(t);
    if (row_lat != between_lat_ || first != between_lon_) {
      for (int i = 0; i < 4; ++i)
        between_[static_cast<std::size_t>(i)] = post(row_lat, first + (i - 1) * std::int64_t{step});
      between_lat_ = row_lat, between_lon_ = first;
    }
    double sum = 0;
    for (std::size_t i = 0; i < 4; ++i) sum += w[i] * between_[i];
    if (!std::isnan(sum)) return sum;
    return (1 - t) * between_[1] + t * between_[2];
  }

  // Along a circle of latitude.
  void row(std::int64_t lat, std::span<const std::int64_t> lons, double* out) {
    const std::int64_t step = lat_step(), first = floor_to(lat, step);
    const std::size_t n = lons.size();
    if (first == lat) {
      const std::vector<double>& on = along(lat, lons);
      std::copy(on.begin(), on.end(), out);
      return;
    }
    const double t = static_cast<double>(lat - first) / static_cast<double>(step);
    const std::array<double, 4> w = cubic_weights(t);
    std::array<const double*, 4> rows{};
    for (int i = 0; i < 4; ++i) rows[static_cast<std::size_t>(i)] = along(first + (i - 1) * step, lons).data();
    for (std::size_t c = 0; c < n; ++c) {
      double sum = 0;
      for (std::size_t i = 0; i < 4; ++i) sum += w[i] * rows[i][c];
      out[c] = std::isnan(sum) ? weighted(1 - t, rows[1][c]) + weighted(t, rows[2][c]) : sum;
    }
  }

  // Of the nearest posts, along a circle of latitude: many rows have the same.
  void append_sources(std::int64_t lat, std::span<const std::int64_t> lons, std::vector<SourceMark>& out) {
    const std::int64_t nearest = std::clamp<std::int64_t>(floor_to(lat + lat_step() / 2, lat_step()), 0, kLatTicks);
    const std::size_t n = lons.size(), before = out.size();
    for (std::size_t c = 0; c < n; ++c)
      out.push_back(nearest == sourced_lat_ ? out[before - n + c]
                                            : source(static_cast<std::int32_t>(nearest), lons[c]));
    sourced_lat_ = nearest;
  }

 private:
  SourceMark source(std::int32_t row_lat, std::int64_t lon) {
    const std::int32_t step = lon_step(row_lat);
    const std::int64_t nearest_lon = floor_to(std::int64_t{wrap_lon(lon)} + step / 2, step);
    if (row_lat == marked_lat_ && nearest_lon == marked_lon_) return mark_;
    const Place p = place(row_lat, nearest_lon);
    marked_lat_ = row_lat, marked_lon_ = nearest_lon;
    return mark_ = p.block ? p.block->source(p.r, p.c) : kNoSource;
  }

  struct Place {
    const Block* block = nullptr;
    int r = 0, c = 0;
  };

  // The same columns each time: a row of posts serves the rows between it and the next ones.
  const std::vector<double>& along(std::int64_t lat, std::span<const std::int64_t> lons) {
    const auto [found, is_new] = rows_.try_emplace(lat);
    std::vector<double>& out = found->second;
    if (is_new)
      for (const std::int64_t lon : lons) out.push_back(along_row(lat, lon));
    return out;
  }

  // Where rows of blocks meet whose posts are differently far apart, the row belongs to those farther apart.
  std::int32_t lon_step(std::int32_t lat) {
    if (lat == stepped_lat_) return lon_step_;
    const auto of = [&](std::int32_t beside) {
      const BlockId id = block_at(level_, beside, 0);
      return lat_step() << lon_shift(level_, id.row);
    };
    stepped_lat_ = lat;
    return lon_step_ = std::max(of(std::clamp(lat, 0, kLatTicks - 1)), of(std::clamp(lat - 1, 0, kLatTicks - 1)));
  }

  Place place(std::int32_t lat, std::int64_t lon) {
    const std::int32_t wrapped = wrap_lon(lon);
    // The last row of a block is the first of the next: of the pole there is no next.
    BlockId id = block_at(level_, std::min(lat, kLatTicks - 1), wrapped);
    Place p = in_block(id, lat, wrapped);
    // Where the posts of the block to the north are missing, those of the southern one may be there.
    if (p.block || lat == 0) return p;
    return in_block(block_at(level_, lat - 1, wrapped), lat, wrapped);
  }

  Place in_block(const BlockId& id, std::int32_t lat, std::int32_t lon) {
    const Block* block = posts_ == Posts::taken ? part(id, lat, lon) : find(id, [&] { return made(id); });
    if (!block) return {};
    const BlockExtent& e = block->extent;
    return {block, (lat - e.lat0) / e.lat_step, (lon - e.lon0) / e.lon_step};
  }

  double post(std::int32_t lat, std::int64_t lon) {
    const Place p = place(lat, lon);
    return p.block ? static_cast<double>(p.block->vertices[p.block->index(p.r, p.c)].height_m) : kNaN;
  }

  const Block* part(const BlockId& id, std::int32_t lat, std::int32_t lon) {
    const BlockExtent e = extent_of(id);
    const Part part = Part::of(id, (lat - e.lat0) / e.lat_step, (lon - e.lon0) / e.lon_step);
    return find(part.key(), [&] { return ground_.taken(part, stop_); });
  }

  template <typename Make>
  const Block* find(const BlockId& key, const Make& make) {
    if (latest_ && latest_id_ == key) return latest_;
    auto found = blocks_.find(key);
    if (found == blocks_.end()) found = blocks_.emplace(key, make()).first;
    latest_id_ = key, latest_ = found->second.get();
    return latest_;
  }

  std::shared_ptr<const Block> made(const BlockId& id) const {
    return posts_ == Posts::of_layer ? ground_.posts_of_layer(id, stop_) : ground_.plain_->block(id, stop_);
  }

  const DetailedTerrain& ground_;
  int level_;
  Posts posts_;
  const StopToken& stop_;
  std::unordered_map<BlockId, std::shared_ptr<const Block>, BlockIdHash> blocks_;
  BlockId latest_id_;
  const Block* latest_ = nullptr;
  std::unordered_map<std::int64_t, std::vector<double>> rows_;
  std::int32_t stepped_lat_ = -1, lon_step_ = 0;
  std::int32_t between_lat_ = -1;
  std::int64_t between_lon_ = -1;
  std::array<double, 4> between_{};
  std::int64_t sourced_lat_ = -1;
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

// Blocks may be smaller than the gap between the last posts of a tile and the first of the next, where there is a
// surface: posts are asked for.
bool DetailedTerrain::has_data(const BlockId& id) const {
  return plain_->has_data(ancestor_of(id, std::min(id.level, plain_->posts_level(id))));
}

bool DetailedTerrain::reached(const BlockId& id) const {
  if (detail_->preset().region.everywhere()) return true;
  const BlockId of_posts = ancestor_of(id, std::min(id.level, plain_->posts_level(id)));
  const Circle all = circle_around(footprint_of(of_posts));
  // A child's ball may stick out of its parent's. What detail takes from posts reaches some posts beyond it.
  constexpr double kSure = 1.01, kPosts = 4;
  const int level = std::min(of_posts.level, layers_.coarsest_detail(id));
  return detail_->reaches(all.middle, kSure * all.radius_m + kPosts * post_spacing_m(level));
}

int DetailedTerrain::posts_level(const BlockId& id) const {
  return has_data(id) && reached(id) ? std::max(plain_->finest_level(id), detail_->finest_level())
                                     : plain_->finest_level(id);
}

bool DetailedTerrain::has_detail(const BlockId& id) const {
  return id.level > layers_.coarsest_detail(id) && (reached(id) || id.level > plain_->posts_level(id));
}

bool DetailedTerrain::of_coarse_posts_alone(const BlockId& id) const {
  return layers_.coarsest(id) < std::min(id.level, plain_->posts_level(id)) && layers_.of(id)->size() == 1 &&
         has_detail(id);
}

double DetailedTerrain::left_out_size_m(const BlockId& id) const {
  const int coarsest = layers_.coarsest_detail(id);
  const int shown = id.level > coarsest ? Detail::smallest_octave(id.level) : std::numeric_limits<int>::max();
  return detail_->left_out_size_m(std::min(shown, Detail::past_largest_octave(coarsest)));
}

NodeInfo DetailedTerrain::node(const BlockId& id, const StopToken& stop) const {
  const auto of_made = [](const Block& made) {
    return NodeInfo{made.error_m, made.min_m, made.max_m, false, {}, made.detail_error_m, made.left_out_size_m};
  };
  // Files that can't be used are the exception: then the plain terrain is asked. A frame asks for thousands of blocks.
  const bool all_used = !plain_->has_replacements();
  if (all_used)
    if (const auto here = plain_->blocks().find(key_of(number_, static_cast<int>(Kind::made), id)); here && *here)
      return of_made(**here);
  if (has_detail(id)) {
    const auto made = block(id, stop);
    if (!made) return {};
    NodeInfo info = of_made(*made);
    if (!all_used || !of_coarse_posts_alone(id)) info.replaced = plain_->node(id, stop).replaced;
    return info;
  }
  NodeInfo info = plain_->node(id, stop);
  if (info.empty || !reached(id)) return info;
  const int posts = layers_.coarsest(id);
  // Between the posts the surface is curved: by no more, about, than posts lie off the surface of every second one. Of
  // much coarser levels half of their own error is more than that: rough ground is rougher over longer distances.
  constexpr int kMuchCoarser = 3;
  double bend = 0;
  if (id.level + kMuchCoarser <= posts)
    bend = info.error_m / 2;
  else if (posts > 0)
    bend = id.level < posts ? info.error_m : plain_->node(ancestor_of(id, posts - 1), stop).error_m;
  const double beyond = bend + detail_->beyond_posts_m(layers_.coarsest_detail(id));
  info.error_m += beyond, info.detail_error_m = beyond, info.left_out_size_m = left_out_size_m(id);
  info.min_m -= static_cast<float>(beyond), info.max_m += static_cast<float>(beyond);
  return info;
}

std::optional<HeightRange> DetailedTerrain::heights_without_building(const BlockId& id, const StopToken& stop) const {
  std::optional<HeightRange> range = plain_->heights_without_building(id, stop);
  if (!range || !reached(id)) return range;
  // Catmull-Rom's overshoot: an eighth of the range on either side of each axis, at most.
  const float beyond =
      static_cast<float>(detail_->beyond_posts_m(layers_.coarsest_detail(id))) + 0.3F * (range->high - range->low);
  range->low -= beyond, range->high += beyond;
  return range;
}

// Every third level of detail is made: of those in between the heights follow from a coarser level's, of the first ones
// from the posts.
std::optional<NodeInfo> DetailedTerrain::outline(const BlockId& id, const StopToken& stop) const {
  constexpr int kOfPosts = 5, kApart = 3;
  if (!has_detail(id) || plain_->has_replacements() || id.level >= finest_level(id)) return std::nullopt;
  const LayeredPosts::Layers layers = layers_.of(id);
  const LayeredPosts::Layer& layer = layers->front();
  const int finer = id.level - layer.level;
  if (layers->size() > 1 || finer <= 0) return std::nullopt;
  const int past = finer - kOfPosts - 1;  // the first level that is made, and those after it
  if (past >= 0 && past % kApart == 0) return std::nullopt;
  const auto heights =
      past < 0 ? heights_of_posts(id, layer, stop) : heights_within(id, id.level - past % kApart, stop);
  if (!heights) return std::nullopt;
  NodeInfo info{detail_->left_out_m(id.level, layer.detail_level), heights->low, heights->high, false, {}};
  info.detail_error_m = info.error_m, info.left_out_size_m = left_out_size_m(id);
  return info;
}

std::optional<HeightRange> DetailedTerrain::heights_of_posts(const BlockId& id, const LayeredPosts::Layer& layer,
                                                             const StopToken& stop) const {
  auto outline = plain_->blocks().find(key_of(number_, static_cast<int>(Kind::outline), id));
  if (!outline)
    outline = once_posts_are_there(
        id, stop, [&] { return kept(Kind::outline, id, stop, [&] { return outline_of_posts(id, layer, stop); }); });
  if (!*outline) return std::nullopt;
  return HeightRange{(*outline)->min_m, (*outline)->max_m};
}

std::shared_ptr<const Block> DetailedTerrain::outline_of_posts(const BlockId& id, const LayeredPosts::Layer& layer,
                                                               const StopToken& stop) const {
  const BlockExtent e = extent_of(id), of_posts = extent_of(ancestor_of(id, layer.level));
  PostsAround posts(*this, layer.level, PostsAround::Posts::of_layer, stop);
  HeightRange range{kHighestRelief_m, kLowestRelief_m};
  // Those that a place is interpolated from.
  const auto first = [](std::int64_t place, std::int64_t step) { return floor_to(place, step) - step; };
  for (std::int64_t lat = first(e.lat0, of_posts.lat_step); lat <= e.lat1() + 2 * of_posts.lat_step;
       lat += of_posts.lat_step)
    for (std::int64_t lon = first(e.lon0, of_posts.lon_step); lon <= e.lon1() + 2 * of_posts.lon_step;
         lon += of_posts.lon_step) {
      const auto height_m = static_cast<float>(posts.along_row(lat, lon));
      if (std::isnan(height_m)) return nullptr;
      range.low = std::min(range.low, height_m), range.high = std::max(range.high, height_m);
    }
  // Catmull-Rom's overshoot is 0.28 of the range; beside posts twice as far apart there is some along the row, too.
  constexpr float kOvershoot = 0.6F;
  const float beyond =
      kOvershoot * (range.high - range.low) + static_cast<float>(detail_->beyond_posts_m(layer.detail_level));
  auto outline = std::make_shared<Block>();
  outline->id = id, outline->min_m = range.low - beyond, outline->max_m = range.high + beyond;
  return outline;
}

std::optional<HeightRange> DetailedTerrain::heights_within(const BlockId& id, int level, const StopToken& stop) const {
  const auto coarser = block(ancestor_of(id, level), stop);
  if (!coarser) return std::nullopt;
  const BlockExtent e = extent_of(id), &of = coarser->extent;
  HeightRange range{kHighestRelief_m, kLowestRelief_m};
  const auto past = [](std::int32_t length, std::int32_t step) { return (length + step - 1) / step; };
  for (int r = (e.lat0 - of.lat0) / of.lat_step; r <= past(e.lat1() - of.lat0, of.lat_step); ++r)
    for (int c = (e.lon0 - of.lon0) / of.lon_step; c <= past(e.lon1() - of.lon0, of.lon_step); ++c) {
      const float height_m = coarser->vertices[coarser->index(r, c)].height_m;
      if (std::isnan(height_m)) return std::nullopt;
      range.low = std::min(range.low, height_m), range.high = std::max(range.high, height_m);
    }
  const auto beyond = static_cast<float>(coarser->error_m);
  return HeightRange{range.low - beyond, range.high + beyond};
}

std::shared_ptr<const Block> DetailedTerrain::block(const BlockId& id, const StopToken& stop) const {
  return known_or(id, stop, [&] { return kept(Kind::made, id, stop, [&] { return read_or_made(id, stop); }); });
}

std::shared_ptr<const Block> DetailedTerrain::block_or_quad(const BlockId& id, std::int32_t lat, std::int32_t lon,
                                                            const StopToken& stop) const {
  const BlockExtent e = extent_of(id);
  return known_or(id, stop, [&] {
    const auto first = [](std::int32_t place, std::int32_t from, std::int32_t step) {
      return from + (place - from) / step * step;
    };
    return quad(id, {first(lat, e.lat0, e.lat_step), first(lon, e.lon0, e.lon_step), e.lat_step, e.lon_step, 1}, stop);
  });
}

template <typename Make>
std::shared_ptr<const Block> DetailedTerrain::known_or(const BlockId& id, const StopToken& stop,
                                                       const Make& make) const {
  if (!has_detail(id)) return plain_->block(id, stop);
  if (const auto here = plain_->blocks().find(key_of(number_, static_cast<int>(Kind::made), id))) return *here;
  return once_posts_are_there(id, stop, make);
}

template <typename Make>
std::shared_ptr<const Block> DetailedTerrain::once_posts_are_there(const BlockId& id, const StopToken& stop,
                                                                   const Make& make) const {
  // As of the plain terrain's blocks: a pyramid is waited for out here, and who begins to make a block has his place in
  // the arena, which those who wait for the block may have taken all the others of.
  if (!of_coarse_posts_alone(id)) plain_->node(ancestor_of(id, std::min(id.level, plain_->posts_level(id))), stop);
  std::shared_ptr<const Block> block;
  where_loops_run([&] { block = make(); });
  return block;
}

template <typename Make>
std::shared_ptr<const Block> DetailedTerrain::kept(Kind kind, const BlockId& id, const StopToken& stop,
                                                   const Make& make) const {
  return plain_->blocks().get(
      key_of(number_, static_cast<int>(kind), id),
      [&] {
        std::shared_ptr<const Block> one = make();
        const std::size_t bytes = one ? one->bytes() : sizeof(Block);
        return BlockCache::Loaded{std::move(one), bytes};
      },
      stop);
}

std::shared_ptr<const Block> DetailedTerrain::posts_of_layer(const BlockId& id, const StopToken& stop) const {
  // Coarser blocks of a pyramid are means of finer posts.
  if (id.level == plain_->posts_level(id)) return plain_->block(id, stop);
  return kept(Kind::beneath, id, stop, [&] { return posts_beneath(id, stop); });
}

std::shared_ptr<const Block> DetailedTerrain::taken(const Part& part, const StopToken& stop) const {
  return kept(Kind::taken, part.key(), stop, [&] { return make_taken(part, stop); });
}

std::shared_ptr<Block> DetailedTerrain::posts_beneath(const BlockId& id, const StopToken& stop) const {
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

std::shared_ptr<Block> DetailedTerrain::make_taken(const Part& part, const StopToken& stop) const {
  const BlockExtent e = part.extent();
  const auto side = static_cast<std::size_t>(e.quads + 1 + 2 * kCellsAround);
  const std::vector<double> out = sharpened(cell_means(part, kCellsAround, stop), side);
  auto block = empty_block(part.block, e);
  block->vertices.reserve(block->index(e.quads, e.quads) + 1);
  for (int r = 0; r <= e.quads; ++r) {
    const double share = share_of_means(e.lat0 + r * e.lat_step, e.lat_step);
    for (int c = 0; c <= e.quads; ++c) {
      const std::size_t at =
          static_cast<std::size_t>(r + kCellsAround) * side + static_cast<std::size_t>(c + kCellsAround);
      block->vertices.push_back({static_cast<float>(share * out[at]), Eigen::Vector3f::Zero()});
    }
  }
  return block;
}

// Places are the block's, so that a cell's mean does not depend on the part to the bit.
std::vector<double> DetailedTerrain::cell_means(const Part& part, int around, const StopToken& stop) const {
  const BlockExtent e = extent_of(part.block);
  const auto cells = static_cast<std::size_t>(part.quads() + 1 + 2 * around);
  std::vector<double> means(cells * cells);
  for (int octave = Detail::smallest_octave(part.block.level + Detail::kCellLevels);
       octave < Detail::past_largest_octave(part.block.level); ++octave) {
    const int places = Detail::places_in_cell(octave, part.block.level);
    const auto n = static_cast<std::size_t>(places);
    const Places all(e, 0.5 / places - 0.5 - around, 1.0 / places, (e.quads + 1 + 2 * around) * places);
    const auto first = [&](int parts) { return static_cast<std::size_t>(parts * part.quads()) * n; };
    // Squares, whose places are found in caches.
    constexpr std::size_t kSquare = 9;
    const std::size_t squares = (cells + kSquare - 1) / kSquare;
    in_parallel(squares * squares, [&](std::size_t i) {
      const std::size_t r0 = i / squares * kSquare, c0 = i % squares * kSquare;
      const std::size_t rows = std::min(kSquare, cells - r0), columns = std::min(kSquare, cells - c0);
      std::vector<double> heights(rows * n * columns * n);
      detail_->add_octave(
          part_of(all.grid(), first(part.north) + r0 * n, rows * n, first(part.east) + c0 * n, columns * n), octave,
          heights, stop);
      const double* height_m = heights.data();
      for (std::size_t r = r0 * n; r < (r0 + rows) * n; ++r)
        for (std::size_t c = c0; c < c0 + columns; ++c)
          for (std::size_t k = 0; k < n; ++k) means[r / n * cells + c] += *height_m++ / (places * places);
    });
  }
  return means;
}

// At posts of an extent, row by row.
struct DetailedTerrain::Surface {
  std::vector<double> posts_m, heights_m;  // without detail, with it
  std::vector<float> in_crater;
  std::vector<SourceMark> sources;
  std::vector<Ground> ground;  // where no crater is
  double left_out_m;
};

DetailedTerrain::Surface DetailedTerrain::surface_of(const BlockId& id, const BlockExtent& e,
                                                     const LayeredPosts::Layer& layer, const StopToken& stop) const {
  const int side = e.quads + 1;
  const auto n = static_cast<std::size_t>(side);
  const bool finer = id.level > layer.level, shown = id.level > layer.detail_level;
  PostsAround posts(*this, finer ? layer.level : id.level,
                    finer ? PostsAround::Posts::of_layer : PostsAround::Posts::filtered, stop);
  PostsAround taken(*this, layer.detail_level, PostsAround::Posts::taken, stop);
  Surface out{{}, std::vector<double>(n * n), std::vector<float>(n * n), {}, {}, 0};
  out.sources.reserve(n * n);
  std::vector<std::int64_t> lons;
  lons.reserve(n);
  for (int i = 0; i < side; ++i) lons.push_back(e.lon0 + std::int64_t{i} * e.lon_step);
  std::vector<double> taken_m(n);
  for (int r = 0; r < side; ++r) {
    stop.check();
    const std::int64_t lat = e.lat0 + std::int64_t{r} * e.lat_step;
    double* const row_m = out.heights_m.data() + static_cast<std::size_t>(r) * n;
    posts.row(lat, lons, row_m);
    posts.append_sources(lat, lons, out.sources);
    if (!shown) continue;
    taken.row(lat, lons, taken_m.data());
    for (std::size_t c = 0; c < n; ++c) row_m[c] -= taken_m[c];
  }
  out.posts_m = out.heights_m;
  if (!finer) out.left_out_m = plain_->node(id, stop).error_m;
  out.ground.assign(n * n, shown && detail_->has_relief(id.level, layer.detail_level) ? Ground::relief : Ground::dem);
  if (!shown) return out;
  detail_->add(Places(e, 0, 1, side).grid(), id.level, layer.detail_level, out.heights_m, out.in_crater, stop);
  // Where the posts are not there yet, the curve between them is not, either.
  out.left_out_m = 2 * out.left_out_m + detail_->left_out_m(id.level, layer.detail_level);
  return out;
}

// Where a layer begins to count, its own ground over that of those beneath.
void DetailedTerrain::blend(Surface& below, const Surface& above, const BlockExtent& e,
                            const LayeredPosts::Layer& layer) const {
  const int side = e.quads + 1;
  // To the bit one or the other beyond the band: blocks there don't look at both.
  const auto mixed = [](double share, double a, double b) {
    return share == 0 ? a : share == 1 ? b : a + share * (b - a);
  };
  std::size_t at = 0;
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c, ++at) {
      double lat_deg = lat_deg_of(e.lat0 + r * e.lat_step), lon_deg = lon_deg_of(e.lon0 + c * e.lon_step);
      if (std::abs(lat_deg) > 90) lat_deg = std::copysign(180, lat_deg) - lat_deg, lon_deg += 180;
      const double share = layers_.share(layer, lat_deg, lon_deg);
      if (share == 0) continue;
      double &posts_m = below.posts_m[at], &height_m = below.heights_m[at];
      const double added_m = mixed(share, height_m - posts_m, above.heights_m[at] - above.posts_m[at]);
      posts_m = mixed(share, posts_m, above.posts_m[at]);
      height_m = share == 1 ? above.heights_m[at] : posts_m + added_m;
      if (share <= 0.5) continue;
      below.sources[at] = above.sources[at];
      below.in_crater[at] = above.in_crater[at], below.ground[at] = above.ground[at];
    }
  below.left_out_m = std::max(below.left_out_m, above.left_out_m);
}

DetailedTerrain::Surface DetailedTerrain::composed(const BlockId& id, const BlockExtent& e,
                                                   const StopToken& stop) const {
  const LayeredPosts::Layers layers = layers_.of(id);
  Surface surface = surface_of(id, e, layers->front(), stop);
  for (auto layer = layers->begin() + 1; layer != layers->end(); ++layer)
    blend(surface, surface_of(id, e, *layer, stop), e, *layer);
  return surface;
}

std::shared_ptr<const Block> DetailedTerrain::quad(const BlockId& id, const BlockExtent& e,
                                                   const StopToken& stop) const {
  auto block = empty_block(id, e);
  for (const double height_m : composed(id, e, stop).heights_m)
    block->vertices.push_back({static_cast<float>(height_m), Eigen::Vector3f::Zero()});
  return block;
}

std::shared_ptr<const Block> DetailedTerrain::read_or_made(const BlockId& id, const StopToken& stop) const {
  BlockStore* const store = plain_->block_store();
  // Where a file was replaced by a coarser layer, ground is another until it is mended.
  if (!store || detail_->preset().fingerprint == 0 || plain_->has_replacements()) return made(id, stop);
  if (auto block = store->read(key_, id)) return block;
  auto block = made(id, stop);
  if (block && !plain_->has_replacements()) store->write(key_, *block);
  return block;
}

std::shared_ptr<const Block> DetailedTerrain::made(const BlockId& id, const StopToken& stop) const {
  auto block = empty_block(id, extent_of(id));
  const BlockExtent& e = block->extent;
  const auto n = static_cast<std::size_t>(e.quads + 1 + 2 * kHalo);
  const Surface surface = composed(id, with_halo(e), stop);
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
      low = std::min(low, *h), high = std::max(high, *h);
      for (const std::ptrdiff_t step : {std::ptrdiff_t{1}, static_cast<std::ptrdiff_t>(n)})
        if (const float second = h[step] - 2 * *h + h[-step]; !std::isnan(second))
          bend = std::max(bend, static_cast<double>(std::abs(second)));
    }
  if (low > high) return nullptr;
  block->pack();
  // A kink between two posts lies off the line between them by up to half of what the nearer post's second difference
  // says; along two axes, three quarters are more than was ever seen (unit.detail).
  block->error_m = id.level >= finest_level(id) ? 0 : 0.75 * bend + surface.left_out_m;
  block->detail_error_m = block->error_m, block->left_out_size_m = left_out_size_m(id);
  // Layers of finer posts than the block has: what it leaves out of them is no detail.
  if (!of_coarse_posts_alone(id) && layers_.of(id)->back().level > id.level)
    block->detail_error_m = std::max(0.0, block->error_m - plain_->node(id, stop).error_m);
  block->min_m = low - static_cast<float>(block->error_m), block->max_m = high + static_cast<float>(block->error_m);
  fill_shading_normals(*block, rounded, {});
  return block;
}

}  // namespace selenograph::dem
