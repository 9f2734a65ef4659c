#include "dem/map_error/map_error_terrain.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <unordered_map>

#include "dem/detail/footprints.h"
#include "dem/detail/ground_cache.h"
#include "dem/terrain/pyramid_terrain.h"
#include "dem/terrain/subdivided.h"

namespace selenograph::dem {
namespace {

int level_of_resolution(double resolution_m) {
  int level = 0;
  while (level < kMaxLevel && post_spacing_m(level + 1) >= resolution_m) ++level;
  return level;
}

// Calls visit(id) for the blocks of a level that touch a cap around a direction.
template <typename Visit>
void blocks_near(int level, const Vec3& direction, double angle_rad, const Visit& visit) {
  using std::numbers::pi;
  const double latitude = std::asin(std::clamp(direction.z(), -1.0, 1.0)),
               longitude = std::atan2(direction.y(), direction.x());
  const auto row_at = [&](double lat_rad) {
    return block_at_place(level, std::clamp(lat_rad * kDegreesPerRadian, -90.0, 90.0), 0).row;
  };
  // Bound half the cap's range of longitudes: all of them if the cap contains a pole.
  const bool holds_pole = std::abs(latitude) + angle_rad >= pi / 2;
  const double half = holds_pole ? pi : std::asin(std::min(1.0, std::sin(angle_rad) / std::cos(latitude)));
  for (int row = row_at(latitude - angle_rad); row <= row_at(latitude + angle_rad); ++row) {
    const int columns = columns_of(level, row);
    const double middle = (longitude + pi) / (2 * pi) * columns, reach = half / (2 * pi) * columns;
    const auto first = static_cast<std::int64_t>(std::floor(middle - reach)),
               last = static_cast<std::int64_t>(std::floor(middle + reach));
    for (std::int64_t i = 0; i < std::min<std::int64_t>(last - first + 1, columns); ++i)
      visit(BlockId{level, row, static_cast<int>(((first + i) % columns + columns) % columns)});
  }
}

double angle_of(const Circle& circle) { return 2 * std::asin(std::min(1.0, circle.radius_m / (2 * kMoonRadius_m))); }

}  // namespace

MapErrorTerrain::MapErrorTerrain(std::shared_ptr<const Terrain> truth, const MapError& error)
    : truth_(std::move(truth)),
      surface_(error),
      shifted_(error.is_shifted()),
      coarsest_posts_(error.resolution_m > 0 ? level_of_resolution(error.resolution_m) : kMaxLevel),
      number_(truth_->plain().new_detail_number()),
      roots_(truth_->roots()) {
  if (!shifted_) return;
  // A shift may carry ground into roots that have none.
  roots_.clear();
  for (int row = 0; row < rows_of(0); ++row)
    for (int column = 0; column < columns_of(0, row); ++column)
      if (has_data({0, row, column})) roots_.push_back({0, row, column});
}

std::vector<BlockId> MapErrorTerrain::true_blocks(const BlockId& id) const {
  const int level = std::min(id.level, coarsest_posts_);
  if (!shifted_ && id.level <= coarsest_posts_) return {id};
  const Circle circle = circle_around(footprint_of(id));
  std::vector<BlockId> blocks;
  blocks_near(level, surface_.true_direction(circle.middle), angle_of(circle),
              [&](const BlockId& block) { blocks.push_back(block); });
  return blocks;
}

bool MapErrorTerrain::has_data(const BlockId& id) const {
  const std::vector<BlockId> blocks = true_blocks(id);
  return std::any_of(blocks.begin(), blocks.end(), [&](const BlockId& block) { return truth_->has_data(block); });
}

int MapErrorTerrain::posts_level(const BlockId& id) const {
  int level = 0;
  bool has_posts = false;
  for (const BlockId& block : true_blocks(id)) {
    level = std::max(level, truth_->posts_level(block));
    has_posts = has_posts || truth_->has_data(block);
  }
  if (!has_posts) return level;
  level = std::min(level, coarsest_posts_) + (shifted_ ? 1 : 0);
  return std::min(std::max(level, surface_.finest_level()), kMaxLevel);
}

HeightRange MapErrorTerrain::bounds(const BlockId& id, const HeightRange& ground) const {
  const Circle circle = circle_around(footprint_of(id));
  return surface_.bounds(ground, circle.middle, circle.radius_m);
}

NodeInfo MapErrorTerrain::node(const BlockId& id, const StopToken& stop) const {
  NodeInfo info;
  HeightRange ground{kHighestRelief_m, kLowestRelief_m};
  for (const BlockId& block : true_blocks(id)) {
    const NodeInfo truth = truth_->node(block, stop);
    info.replaced.insert(info.replaced.end(), truth.replaced.begin(), truth.replaced.end());
    if (truth.empty) continue;
    info.empty = false;
    ground.low = std::min(ground.low, truth.min_m);
    ground.high = std::max(ground.high, truth.max_m);
    if (id.level >= coarsest_posts_) continue;  // the map shows nothing finer of the true ground
    info.error_m = std::max(info.error_m, truth.error_m);
    info.detail_error_m = std::max(info.detail_error_m, truth.detail_error_m);
    info.left_out_size_m = std::max(info.left_out_size_m, truth.left_out_size_m);
  }
  std::sort(info.replaced.begin(), info.replaced.end());
  info.replaced.erase(std::unique(info.replaced.begin(), info.replaced.end()), info.replaced.end());
  if (info.empty) return info;
  const HeightRange range = bounds(id, ground);
  info.min_m = range.low;
  info.max_m = range.high;
  const bool finest = id.level >= finest_level(id);
  // Interpolated with a shift, a level's triangles are cut once more: by less than they differ from the finest ones.
  const double cut = shifted_ ? 2 : 1;
  info.error_m = finest ? 0 : cut * surface_.error().scale * info.error_m + surface_.left_out_m(id.level);
  info.detail_error_m = finest ? 0 : std::min(info.error_m, cut * surface_.error().scale * info.detail_error_m);
  return info;
}

std::shared_ptr<Block> MapErrorTerrain::unchanged_ground(const BlockId& id, const StopToken& stop) const {
  const auto truth = truth_->block(id, stop);
  return truth ? std::make_shared<Block>(*truth) : nullptr;
}

Ticks MapErrorTerrain::true_place(const Block& block, int r, int c) const {
  if (shifted_) {
    const Geographic shown = to_geographic(surface_.true_direction(block.position(r, c, 0) / kMoonRadius_m));
    return ticks_of(shown.lat_deg, shown.lon_deg);
  }
  // Take a vertex between two blocks from the same one on both sides, even where their posts differ in longitude.
  const Tick lat = block.extent.lat0 + r * block.extent.lat_step,
             lon = wrap_lon(block.extent.lon0 + c * block.extent.lon_step);
  return {static_cast<double>(lat), static_cast<double>(lon), std::min(lat, kLatTicks - 1), lon};
}

std::shared_ptr<Block> MapErrorTerrain::interpolated_ground(const BlockId& id, const StopToken& stop) const {
  auto block = empty_block(id, extent_of(id));
  const int side = block->side(), level = std::min(id.level, coarsest_posts_);
  const auto count = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
  block->vertices.reserve(count);
  block->sources.reserve(count);
  block->ground.reserve(count);
  block->brightness.reserve(count);
  std::unordered_map<BlockId, std::shared_ptr<const Block>, BlockIdHash> loaded;
  const auto vertex_in = [&](const BlockId& true_id, const Ticks& at) {
    const auto [found, is_new] = loaded.try_emplace(true_id);
    if (is_new) found->second = truth_->block(true_id, stop);
    return found->second ? interpolate(*found->second, at.lat, at.lon) : InterpolatedVertex();
  };
  bool has_data = false;
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c) {
      const Ticks at = true_place(*block, r, c);
      InterpolatedVertex vertex = vertex_in(at.block(level), at);
      // Only the block itself has a vertex on its northern or eastern edge where the data end there.
      if (std::isnan(vertex.height_m) && !shifted_)
        vertex = vertex_in(ancestor_of(id, level),
                           {at.lat, static_cast<double>(block->extent.lon0 + c * block->extent.lon_step), 0, 0});
      has_data = has_data || !std::isnan(vertex.height_m);
      block->vertices.push_back(
          {static_cast<float>(vertex.height_m), surface_.map_normal(vertex.normal.normalized()).cast<float>()});
      block->sources.push_back(vertex.source);
      block->ground.push_back(vertex.ground);
      block->brightness.push_back(vertex.brightness);
    }
  return has_data ? block : nullptr;
}

void MapErrorTerrain::apply_errors(Block& block, const StopToken& stop) const {
  SurfaceError::Cursors cursors = surface_.cursors(stop);
  if (surface_.changes_albedo() && block.brightness.empty())
    block.brightness.assign(block.vertices.size(), kBrightnessOfOne);
  for (int r = 0; r < block.side(); ++r)
    for (int c = 0; c < block.side(); ++c) {
      const std::size_t i = block.index(r, c);
      Vertex& vertex = block.vertices[i];
      if (std::isnan(vertex.height_m)) continue;
      const double albedo = block.brightness.empty() ? 1 : static_cast<double>(block.brightness[i]) / kBrightnessOfOne;
      const SurfaceError::Ground ground =
          surface_.apply(block.position(r, c, 0) / kMoonRadius_m,
                         {double{vertex.height_m}, vertex.normal.cast<double>(), albedo}, cursors);
      vertex = {static_cast<float>(ground.height_m), ground.normal.cast<float>()};
      if (!block.brightness.empty())
        block.brightness[i] = static_cast<std::uint16_t>(std::lround(ground.albedo * kBrightnessOfOne));
    }
}

// Load the true ground outside the cache's flight: it waits for pyramids and for flights of its own, and a flight that
// waited for them could hold a slot of the arena that they need (ground_cache.cpp).
std::shared_ptr<const Block> MapErrorTerrain::block(const BlockId& id, const StopToken& stop) const {
  const BlockId key = GroundCache::key_of(number_, GroundCache::Kind::block, id);
  BlockCache& cache = plain().blocks();
  if (const auto hit = cache.find(key)) return *hit;
  const NodeInfo info = node(id, stop);
  std::shared_ptr<Block> ground;
  if (!info.empty)
    ground = shifted_ || id.level > coarsest_posts_ ? interpolated_ground(id, stop) : unchanged_ground(id, stop);
  return cache.get(
      key,
      [&] {
        if (!ground) return BlockCache::Loaded{nullptr, sizeof(Block)};
        apply_errors(*ground, stop);
        ground->pack();
        ground->error_m = info.error_m;
        ground->detail_error_m = info.detail_error_m;
        ground->left_out_size_m = info.left_out_size_m;
        ground->min_m = info.min_m;
        ground->max_m = info.max_m;
        return BlockCache::Loaded{ground, ground->bytes()};
      },
      stop);
}

bool MapErrorTerrain::has_detail(const BlockId& id) const {
  const std::vector<BlockId> blocks = true_blocks(id);
  return std::any_of(blocks.begin(), blocks.end(),
                     [&](const BlockId& block) { return dem::has_detail(*truth_, block); });
}

bool MapErrorTerrain::node_is_cheap(const BlockId& id) const {
  const std::vector<BlockId> blocks = true_blocks(id);
  return std::all_of(blocks.begin(), blocks.end(),
                     [&](const BlockId& block) { return dem::node_is_cheap(*truth_, block); });
}

std::optional<NodeInfo> MapErrorTerrain::outline(const BlockId& id, const StopToken& stop) const {
  if (shifted_ || id.level > coarsest_posts_) return std::nullopt;
  std::optional<NodeInfo> outline = dem::outline(*truth_, id, stop);
  if (!outline) return std::nullopt;
  const HeightRange range = bounds(id, {outline->min_m, outline->max_m});
  outline->min_m = range.low;
  outline->max_m = range.high;
  outline->error_m *= surface_.error().scale;
  outline->detail_error_m *= surface_.error().scale;
  return outline;
}

std::optional<HeightRange> MapErrorTerrain::heights_without_building(const BlockId& id, const StopToken& stop) const {
  HeightRange ground{kHighestRelief_m, kLowestRelief_m};
  for (const BlockId& block : true_blocks(id)) {
    const auto range = dem::heights_without_building(*truth_, block, stop);
    if (!range) return std::nullopt;
    ground.low = std::min(ground.low, range->low);
    ground.high = std::max(ground.high, range->high);
  }
  return bounds(id, ground);
}

}  // namespace selenograph::dem
