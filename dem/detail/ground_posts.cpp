#include "dem/detail/ground_posts.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "dem/grid/shading_normals.h"
#include "dem/posts/post_patch.h"
#include "dem/posts/post_source.h"
#include "dem/pyramid/block_posts.h"

namespace selenograph::dem {
namespace {

// Rounds down to a multiple of a lattice step, which is a power of two.
std::int64_t floor_to(std::int64_t value, std::int64_t step) { return value & -step; }

// Returns weight * value, and 0 for weight 0, where value may be NaN (no data).
double weighted(double weight, double value) { return weight == 0 ? 0 : weight * value; }

}  // namespace

std::shared_ptr<const Block> GroundPosts::block(Kind kind, const BlockId& id, const StopToken& stop) const {
  // The pyramid has unfiltered posts only at their own level. Its coarser blocks are means of finer posts.
  if (kind == Kind::filtered || id.level == plain_.posts_level(id)) return plain_.block(id, stop);
  return cache_.get(GroundCache::Kind::layer_posts, id, stop, [&] { return compose_layers(id, stop); });
}

std::shared_ptr<const Block> GroundPosts::sub_block(Kind kind, const SubBlock& sub_block, const StopToken& stop) const {
  if (kind == Kind::relief_factor)
    return cache_.get(GroundCache::Kind::relief_factor, sub_block.key(), stop,
                      [&] { return make_relief_factors(sub_block, stop); });
  const auto factors = [&](std::span<const std::int64_t> lats, std::span<const std::int64_t> lons) {
    return relief_factors(sub_block.block.level, lats, lons, stop);
  };
  return cache_.get(GroundCache::Kind::mean_correction, sub_block.key(), stop,
                    [&] { return make_mean_correction(detail_, sub_block, factors, stop); });
}

std::vector<double> GroundPosts::relief_factors(int detail_level, std::span<const std::int64_t> lats,
                                                std::span<const std::int64_t> lons, const StopToken& stop) const {
  if (!detail_.relief().follows_posts()) return {};
  PostReader reader(*this, detail_level, Kind::relief_factor, stop);
  std::vector<double> factors(lats.size() * lons.size());
  for (std::size_t r = 0; r < lats.size(); ++r) reader.interpolate_row(lats[r], lons, &factors[r * lons.size()]);
  // Cubic interpolation overshoots, but bounds of heights rely on the factors' range.
  for (double& factor : factors) factor = std::clamp(factor, detail_.relief().min_factor(), 1.0);
  return factors;
}

std::shared_ptr<const Block> GroundPosts::compose_layers(const BlockId& id, const StopToken& stop) const {
  const BlockId root = id.level <= kRootLevel ? id : ancestor_of(id, kRootLevel);
  PostsOfBlock posts = compose_block(root, id, plain_.post_source(), layers_.files_up_to(id.level), stop);
  auto block = empty_block(id, extent_of(id));
  const int side = block->side(), wide = side + 2 * kHalo;
  bool has_heights = false;
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c) {
      const float height_m = posts.heights[static_cast<std::size_t>((r + kHalo) * wide + c + kHalo)];
      block->vertices.push_back({height_m, Vec3f::zero()});
      has_heights |= !std::isnan(height_m);
    }
  if (!has_heights) return nullptr;
  block->sources = std::move(posts.sources);
  block->pack();
  return block;
}

// Takes second differences at all cells that the weights of a post in the sub-block reach. Whole metres of heights add
// half their squared step to each squared difference (weights 1, 4 and 1, variance 1/12).
std::shared_ptr<const Block> GroundPosts::make_relief_factors(const SubBlock& sub_block, const StopToken& stop) const {
  constexpr int kApart = 2, kWindow = 4;  // posts; cells
  const BlockExtent e = sub_block.extent();
  const LayeredPosts::RoughnessPosts source = layers_.roughness_posts(sub_block.block.level);
  PostReader posts(*this, source.level, Kind::of_layer, stop);
  const int finer = source.level - sub_block.block.level;  // levels from cells to posts
  const Tick north = kApart * (e.lat_step >> finer), east = kApart * (e.lon_step >> finer);
  const double noise_m2 = source.quantisation_m * source.quantisation_m / 2;
  const int side = e.quads + 1 + 2 * kWindow;
  // Sums of squares relative to the law's, and numbers of valid ones, by cell.
  std::vector<double> sums(static_cast<std::size_t>(side * side)), counts(sums.size());
  for (std::size_t cell = 0; cell < sums.size(); ++cell) {
    const std::int64_t lat = e.lat0 + (static_cast<int>(cell) / side - kWindow) * e.lat_step,
                       lon = e.lon0 + (static_cast<int>(cell) % side - kWindow) * e.lon_step;
    const double middle_m = posts.height_on_row(lat, lon);
    const auto add = [&](Tick lat_apart, Tick lon_apart, double distance_m) {
      const double law_m = detail_.relief().second_difference_m(distance_m),
                   second_m = posts.height_on_row(lat - lat_apart, lon - lon_apart) - 2 * middle_m +
                              posts.height_on_row(lat + lat_apart, lon + lon_apart);
      if (std::isnan(second_m)) return;
      sums[cell] += (second_m * second_m - noise_m2) / (law_m * law_m);
      counts[cell] += 1;
    };
    constexpr double kMetresPerTick = kMetresPerDegree / kTicksPerDegree;
    const double north_m = kMetresPerTick * static_cast<double>(north),
                 east_m = kMetresPerTick * static_cast<double>(east) *
                          std::abs(std::cos(lat_deg_of(lat) * kRadiansPerDegree));
    add(north, 0, north_m);
    // Beside a pole, where cells are slivers, posts of a row are closer than what they resolve.
    if (east_m > north_m / 4) add(0, east, east_m);
  }
  auto block = empty_block(sub_block.block, e);
  for (int r = 0; r <= e.quads; ++r)
    for (int c = 0; c <= e.quads; ++c) {
      double sum = 0, count = 0;
      for (int y = -kWindow; y <= kWindow; ++y)
        for (int x = -kWindow; x <= kWindow; ++x) {
          const double weight = (kWindow + 1 - std::abs(y)) * (kWindow + 1 - std::abs(x));
          const auto post = static_cast<std::size_t>((r + kWindow + y) * side + c + kWindow + x);
          sum += weight * sums[post];
          count += weight * counts[post];
        }
      // Without data nothing is known of the roughness.
      const double ratio = count > 0 ? std::sqrt(std::max(0.0, sum / count)) : 1;
      block->vertices.push_back(
          {static_cast<float>(std::clamp(ratio, detail_.relief().min_factor(), 1.0)), Vec3f::zero()});
    }
  return block;
}

std::optional<HeightRange> GroundPosts::range_around(const BlockId& id, int layer_level, const StopToken& stop) const {
  const BlockExtent e = extent_of(id), posts_extent = extent_of(ancestor_of(id, layer_level));
  PostReader posts(*this, layer_level, Kind::of_layer, stop);
  HeightRange range{kHighestRelief_m, kLowestRelief_m};
  // Interpolation at a position uses one post before the position's quad and one after it.
  const auto first = [](std::int64_t tick, std::int64_t step) { return floor_to(tick, step) - step; };
  for (std::int64_t lat = first(e.lat0, posts_extent.lat_step); lat <= e.lat1() + 2 * posts_extent.lat_step;
       lat += posts_extent.lat_step)
    for (std::int64_t lon = first(e.lon0, posts_extent.lon_step); lon <= e.lon1() + 2 * posts_extent.lon_step;
         lon += posts_extent.lon_step) {
      const auto height_m = static_cast<float>(posts.height_on_row(lat, lon));
      if (std::isnan(height_m)) return std::nullopt;
      range.low = std::min(range.low, height_m);
      range.high = std::max(range.high, height_m);
    }
  return range;
}

// Continues a row beyond a pole on the opposite meridian. Keeps the four posts of the latest quad of a row.
double PostReader::height_on_row(std::int64_t lat, std::int64_t lon) {
  std::int64_t lon_offset = 0;  // half a turn beyond a pole
  if (lat < 0 || lat > kLatTicks) {
    lat = lat < 0 ? -lat : 2 * kLatTicks - lat;
    lon_offset = kLonTicks / 2;
  }
  const Tick step = lon_step(lat);
  const std::int64_t lon_tick = std::int64_t{wrap_lon(lon + lon_offset)}, first = floor_to(lon_tick, step);
  if (first == lon_tick) return post_m(lat, lon_tick);
  const double t = static_cast<double>(lon_tick - first) / static_cast<double>(step);
  const std::array<double, 4> w = cubic_weights(t);
  if (lat != cached_quad_lat_ || first != cached_quad_lon_) {
    for (int i = 0; i < 4; ++i)
      cached_posts_m_[static_cast<std::size_t>(i)] = post_m(lat, first + (i - 1) * std::int64_t{step});
    cached_quad_lat_ = lat;
    cached_quad_lon_ = first;
  }
  double sum = 0;
  for (std::size_t i = 0; i < 4; ++i) sum += w[i] * cached_posts_m_[i];
  if (!std::isnan(sum)) return sum;
  return (1 - t) * cached_posts_m_[1] + t * cached_posts_m_[2];
}

// Interpolates along the four rows of posts around the latitude, then between these rows.
void PostReader::interpolate_row(std::int64_t lat, std::span<const std::int64_t> lons, double* out) {
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

void PostReader::append_sources(std::int64_t lat, std::span<const std::int64_t> lons, std::vector<SourceMark>& out) {
  const std::int64_t nearest = std::clamp<std::int64_t>(floor_to(lat + lat_step() / 2, lat_step()), 0, kLatTicks);
  const std::size_t n = lons.size(), before = out.size();
  // Copy the sources of the row before where the nearest posts are the same, as they are for most rows.
  for (std::size_t c = 0; c < n; ++c)
    out.push_back(nearest == last_source_lat_ ? out[before - n + c] : source(nearest, lons[c]));
  last_source_lat_ = nearest;
}

SourceMark PostReader::source(Tick lat, std::int64_t lon) {
  const Tick step = lon_step(lat);
  const std::int64_t nearest_lon = floor_to(std::int64_t{wrap_lon(lon)} + step / 2, step);
  if (lat == marked_lat_ && nearest_lon == marked_lon_) return mark_;
  const PostRef p = find_post(lat, nearest_lon);
  marked_lat_ = lat;
  marked_lon_ = nearest_lon;
  return mark_ = p.block ? p.block->source(p.r, p.c) : kNoSource;
}

// Returns the heights on a row of posts. They are cached: interpolate_row needs the same rows again for all rows
// between two rows of posts.
const std::vector<double>& PostReader::heights_on_row(std::int64_t lat, std::span<const std::int64_t> lons) {
  const auto [found, is_new] = rows_.try_emplace(lat);
  std::vector<double>& out = found->second;
  if (is_new)
    for (const std::int64_t lon : lons) out.push_back(height_on_row(lat, lon));
  return out;
}

// Returns the spacing of posts along a row. A row on the border of two rows of blocks with different spacing uses the
// larger one, whose posts both have.
Tick PostReader::lon_step(Tick lat) {
  if (lat == cached_step_lat_) return lon_step_;
  const auto step_at = [&](Tick block_lat) {
    const BlockId id = block_at(level_, block_lat, 0);
    return lat_step() << lon_shift(level_, id.row);
  };
  cached_step_lat_ = lat;
  return lon_step_ = std::max(step_at(std::clamp<Tick>(lat, 0, kLatTicks - 1)),
                              step_at(std::clamp<Tick>(lat - 1, 0, kLatTicks - 1)));
}

double PostReader::post_m(Tick lat, std::int64_t lon) {
  const PostRef p = find_post(lat, lon);
  if (!p.block) return std::numeric_limits<double>::quiet_NaN();
  return static_cast<double>(p.block->vertices[p.block->index(p.r, p.c)].height_m);
}

PostReader::PostRef PostReader::find_post(Tick lat, std::int64_t lon) {
  const Tick wrapped = wrap_lon(lon);
  // A block's last row is the first row of the block to the north. The pole has no block to the north.
  const PostRef p = post_in_block(block_at(level_, std::min(lat, kLatTicks - 1), wrapped), lat, wrapped);
  // If the block to the north has no posts, take the row from the block to the south.
  if (p.block || lat == 0) return p;
  return post_in_block(block_at(level_, lat - 1, wrapped), lat, wrapped);
}

PostReader::PostRef PostReader::post_in_block(const BlockId& id, Tick lat, Tick lon) {
  const bool by_sub_blocks = kind_ == GroundPosts::Kind::mean_correction || kind_ == GroundPosts::Kind::relief_factor;
  const Block* block =
      by_sub_blocks ? sub_block_at(id, lat, lon) : find_block(id, [&] { return ground_.block(kind_, id, stop_); });
  if (!block) return {};
  const BlockExtent& e = block->extent;
  return {block, steps_in(lat - e.lat0, e.lat_step), steps_in(lon - e.lon0, e.lon_step)};
}

const Block* PostReader::sub_block_at(const BlockId& id, Tick lat, Tick lon) {
  const BlockExtent e = extent_of(id);
  const SubBlock sub_block = SubBlock::of(id, steps_in(lat - e.lat0, e.lat_step), steps_in(lon - e.lon0, e.lon_step));
  return find_block(sub_block.key(), [&] { return ground_.sub_block(kind_, sub_block, stop_); });
}

template <typename Load>
const Block* PostReader::find_block(const BlockId& key, const Load& load) {
  if (latest_ && latest_id_ == key) return latest_;
  auto found = blocks_.find(key);
  if (found == blocks_.end()) found = blocks_.emplace(key, load()).first;
  latest_id_ = key;
  latest_ = found->second.get();
  return latest_;
}

}  // namespace selenograph::dem
