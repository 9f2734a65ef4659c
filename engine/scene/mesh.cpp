#include "engine/scene/mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/terrain/pyramid_terrain.h"
#include "dem/terrain/surface_place.h"

namespace selenograph::engine {
namespace {

using dem::BlockExtent;
using dem::BlockId;

// Returns true if two blocks share at least a point. All blocks that end at a pole share it.
bool share_point(const BlockExtent& a, const BlockExtent& b) {
  if (a.lat0 > b.lat1() || b.lat0 > a.lat1()) return false;
  if ((a.lat0 == 0 && b.lat0 == 0) || (a.lat1() == dem::kLatTicks && b.lat1() == dem::kLatTicks)) return true;
  const auto overlap = [&](std::int64_t shift) { return a.lon0 + shift <= b.lon1() && b.lon0 <= a.lon1() + shift; };
  return overlap(0) || overlap(dem::kLonTicks) || overlap(-std::int64_t{dem::kLonTicks});
}

// Returns the index of the i-th vertex of an edge, from west or south.
std::size_t edge_index(const dem::Block& block, int edge, int i) {
  const int quads = block.extent.quads;
  return edge < 2 ? block.index(edge == 0 ? 0 : quads, i) : block.index(i, edge == 2 ? 0 : quads);
}

bool touches_any(const BlockExtent& block, const std::vector<BlockExtent>& extents) {
  return std::any_of(extents.begin(), extents.end(),
                     [&](const BlockExtent& extent) { return share_point(block, extent); });
}

}  // namespace

bool BlockBorder::operator==(const BlockBorder& border) const {
  if (stride != border.stride || soft != border.soft) return false;
  for (std::size_t edge = 0; edge < 4; ++edge)
    if (height[edge].size() != border.height[edge].size() ||
        std::memcmp(height[edge].data(), border.height[edge].data(), height[edge].size() * sizeof(float)) != 0)
      return false;
  return true;
}

MeshBlock::MeshBlock(std::shared_ptr<const dem::Block> block, BlockBorder joined)
    : posts(std::move(block)),
      border(std::move(joined)),
      side(posts->side()),
      axis(0),
      collapses(border.stride != std::array{1, 1, 1, 1}) {
  const int quads = posts->extent.quads;
  const Vec3 middle = posts->position(quads / 2, quads / 2, 0);
  for (int i = 1; i < 3; ++i)
    if (std::abs(middle[i]) > std::abs(middle[axis])) axis = i;
  vertices = posts->vertices;
  brightness = posts->brightness;
  if (!border_is_unchanged()) {
    own_ = posts->vertices;
    if (border.soft != 0) soften_normals(own_, side, border.soft);
    for (int edge = 0; edge < 4; ++edge)
      for (int i = 0; i <= quads; ++i) {
        const auto e = static_cast<std::size_t>(edge);
        own_[edge_index(*posts, edge, i)] = {border.height[e][static_cast<std::size_t>(i)],
                                             own_[edge_index(*posts, edge, i - i % border.stride[e])].normal};
      }
    vertices = own_;
  }
  for (std::size_t i = 0; i < posts->sin_lat.size(); ++i) rows.push_back({posts->sin_lat[i], posts->cos_lat[i]});
  for (std::size_t i = 0; i < posts->sin_lon.size(); ++i) columns.push_back({posts->sin_lon[i], posts->cos_lon[i]});
  source = posts->source(quads / 2, quads / 2);
  if (posts->sources.size() == 1) return;
  mixed.assign(static_cast<std::size_t>(quads), 0);
  for (int r = 0; r < quads; ++r)
    for (int c = 0; c < quads; ++c)
      for (const auto& [dr, dc] : {std::pair{0, 0}, {0, 1}, {1, 0}, {1, 1}})
        if (posts->source(r + dr, c + dc) != source) mixed[static_cast<std::size_t>(r)] |= std::uint64_t{1} << c;
}

bool MeshBlock::border_is_unchanged() const {
  if (collapses || border.soft != 0) return false;
  for (int edge = 0; edge < 4; ++edge)
    for (int i = 0; i <= posts->extent.quads; ++i)
      if (std::bit_cast<std::uint32_t>(border.height[static_cast<std::size_t>(edge)][static_cast<std::size_t>(i)]) !=
          std::bit_cast<std::uint32_t>(posts->vertices[edge_index(*posts, edge, i)].height_m))
        return false;
  return true;
}

std::size_t MeshBlock::bytes() const {
  return sizeof(MeshBlock) + own_.size() * sizeof(dem::Vertex) + (rows.size() + columns.size()) * sizeof(Turn) +
         mixed.size() * sizeof(std::uint64_t) + 4 * static_cast<std::size_t>(side) * sizeof(float);
}

std::vector<std::shared_ptr<const dem::Block>> load_blocks(const dem::Terrain& terrain, const std::vector<BlockId>& ids,
                                                           const Mesh* before, const StopToken& stop) {
  std::vector<std::shared_ptr<const dem::Block>> loaded(ids.size());
  in_parallel(ids.size(), [&](std::size_t i) {
    if (const auto shared = before ? before->share(ids[i]) : nullptr) {
      loaded[i] = shared->posts;
      return;
    }
    stop.check();
    loaded[i] = terrain.block(ids[i], stop);
  });
  return loaded;
}

Mesh::Mesh(const dem::Terrain& terrain, const std::vector<BlockId>& ids, const Mesh* before, const StopToken& stop,
           const std::vector<Corners>& soft) {
  std::vector<std::shared_ptr<const dem::Block>> loaded;
  {
    const Waiting loading(stop.waits(), &Waits::load);
    loaded = load_blocks(terrain, ids, before, stop);
  }
  if (ids.size() > TriangleId::kMaxBlocks)
    throw std::length_error(fmt::format("mesh: {} blocks are more than {}", ids.size(), TriangleId::kMaxBlocks));
  // Index the blocks that have data.
  coarsest_ = dem::kMaxLevel;
  index_.reserve(ids.size());
  std::vector<Corners> soft_corners;
  for (std::size_t i = 0; i < loaded.size(); ++i) {
    auto& posts = loaded[i];
    if (!posts) continue;
    soft_corners.push_back(soft.empty() ? Corners{0} : soft[i]);
    coarsest_ = std::min(coarsest_, posts->id.level);
    finest_ = std::max(finest_, posts->id.level);
    index_[posts->id] = static_cast<std::uint32_t>(posts_.size());
    posts_.push_back(std::move(posts));
  }
  posts_levels_.resize(posts_.size());
  in_parallel_pieces(posts_.size(), 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) posts_levels_[i] = terrain.plain().posts_level(posts_[i]->id);
  });
  blocks_.resize(posts_.size());
  // Stitch the blocks that are new or next to a change; reuse all others as they are.
  const std::vector<BlockExtent> changed = before ? changes_since(*before) : std::vector<BlockExtent>{};
  in_parallel(blocks_.size(), [&](std::size_t i) {
    stop.check();
    const auto previous = before ? before->share(posts_[i]->id) : nullptr;
    if (previous && previous->border.soft == soft_corners[i] && !touches_any(posts_[i]->extent, changed)) {
      blocks_[i] = previous;
      return;
    }
    // Stitch the border, and still reuse the previous block if the border came out the same.
    BlockBorder border = border_of(*posts_[i]);
    border.soft = soft_corners[i];
    blocks_[i] = previous && previous->border == border
                     ? previous
                     : std::make_shared<const MeshBlock>(posts_[i], std::move(border));
  });
  varies_in_brightness_ =
      std::any_of(blocks_.begin(), blocks_.end(), [](const auto& block) { return !block->brightness.empty(); });
}

std::shared_ptr<const MeshBlock> Mesh::share(const BlockId& id) const {
  const auto found = index_.find(id);
  return found == index_.end() ? nullptr : blocks_[found->second];
}

// Returns the extents of blocks that only one of the two meshes contains.
std::vector<BlockExtent> Mesh::changes_since(const Mesh& before) const {
  std::vector<BlockExtent> changed;
  for (const auto& posts : posts_)
    if (!before.holds(posts->id)) changed.push_back(posts->extent);
  for (const auto& posts : before.posts_)
    if (!holds(posts->id)) changed.push_back(posts->extent);
  return changed;
}

std::optional<std::uint32_t> Mesh::block_at(std::int64_t lat_tick, std::int64_t lon_tick, int finest_level) const {
  if (lat_tick < 0 || lat_tick > dem::kLatTicks) return std::nullopt;
  const auto lat = static_cast<dem::Tick>(lat_tick);
  const dem::Tick lon = dem::wrap_lon(lon_tick);
  for (int level = std::min(finest_, finest_level); level >= coarsest_; --level)
    if (const auto found = index_.find(dem::block_at(level, lat, lon)); found != index_.end()) return found->second;
  return std::nullopt;
}

std::optional<std::uint32_t> Mesh::block_at(const Vec3& position_m) const {
  const Geographic g = to_geographic(position_m);
  const dem::Ticks ticks = dem::ticks_of(g.lat_deg, g.lon_deg);
  return block_at(ticks.whole_lat, ticks.whole_lon);
}

// Returns true if a common edge takes its heights from `block`: the coarser one or, at one level, the one of the
// coarser posts. A finer post beside those lies on a curve, theirs on a chord, in every frame (dem::Terrain::height).
bool Mesh::is_before(std::uint32_t block, std::uint32_t neighbour) const {
  const auto key = [&](std::uint32_t i) { return std::tuple(posts_[i]->id.level, posts_levels_[i], posts_[i]->id); };
  return key(block) < key(neighbour);
}

BlockBorder Mesh::border_of(const dem::Block& block) const {
  BlockBorder border;
  for (int edge = 0; edge < 4; ++edge) stitch_edge(block, edge, border);
  return border;
}

// Sets the stride and the heights of an edge of the block `own`: as coarse as the neighbour beyond it, with heights by
// the order of is_before(). Positions are in ticks.
void Mesh::stitch_edge(const dem::Block& own, int edge, BlockBorder& out) const {
  const BlockExtent& extent = own.extent;
  const bool along_lon = edge < 2;
  const dem::Tick step = along_lon ? extent.lon_step : extent.lat_step;
  // lat_out and lon_out lie just outside the edge; lat_edge and lon_edge are on it.
  const std::int64_t lat_out = edge == 0 ? std::int64_t{extent.lat0} - 1 : edge == 1 ? std::int64_t{extent.lat1()} : 0;
  const std::int64_t lon_out = edge == 2 ? std::int64_t{extent.lon0} - 1 : edge == 3 ? std::int64_t{extent.lon1()} : 0;
  const std::int64_t lat_edge = edge == 1 ? extent.lat1() : extent.lat0,
                     lon_edge = edge == 3 ? extent.lon1() : extent.lon0;
  // At a pole the edge is one point, shared by all blocks around it: only its height is stitched.
  const bool is_pole = along_lon && (lat_edge == 0 || lat_edge == dem::kLatTicks);
  // A neighbour that is at least as coarse spans the whole edge, so one probe across decides. Finer neighbours stitch
  // themselves.
  std::optional<std::uint32_t> neighbour_index;
  if (!is_pole) neighbour_index = along_lon ? block_at(lat_out, extent.lon0) : block_at(extent.lat0, lon_out);
  const dem::Block* neighbour = neighbour_index ? posts_[*neighbour_index].get() : nullptr;
  int stride = 1;
  if (neighbour) {
    const dem::Tick across = along_lon ? neighbour->extent.lon_step : neighbour->extent.lat_step;
    stride = std::max(1, dem::steps_in(across, step));
  }
  out.stride[static_cast<std::size_t>(edge)] = std::min(stride, extent.quads);
  // If the longitude step halves toward the equator, several neighbours of one level share the edge: resolve each
  // vertex by itself.
  const bool has_several_neighbours =
      neighbour && along_lon &&
      dem::lon_shift(own.id.level, own.id.row + (edge == 1 ? 1 : -1)) < dem::lon_shift(own.id.level, own.id.row);
  const bool neighbour_first = neighbour_index && is_before(*neighbour_index, index_.at(own.id));
  const int remaining_stride = out.stride[static_cast<std::size_t>(edge)];
  std::vector<float>& heights = out.height[static_cast<std::size_t>(edge)];
  heights.reserve(static_cast<std::size_t>(extent.quads) + 1);
  for (int i = 0; i <= extent.quads; ++i) {
    if (i % remaining_stride != 0) {
      heights.push_back(heights.back());
      continue;
    }
    const std::int64_t lat = along_lon ? lat_edge : extent.lat0 + std::int64_t{i} * extent.lat_step;
    const std::int64_t lon = along_lon ? extent.lon0 + std::int64_t{i} * extent.lon_step : lon_edge;
    float height_m = own.vertices[edge_index(own, edge, i)].height_m;
    if (i == 0 || i == extent.quads || has_several_neighbours) {
      height_m = corner_height(own.id, lat, lon);
    } else if (neighbour && (neighbour_first || std::isnan(height_m))) {
      height_m = dem::post_at(*neighbour, lat, lon).value_or(height_m);
    }
    heights.push_back(height_m);
  }
}

// Returns the height of a corner, from the block that precedes all others by is_before() among those that contain it
// with data; NaN if none has any. A block owns its south and west edge, so that a tick less finds the others:
//
//      (-1, 0) | ( 0, 0)
//      --------+--------   (dx, dy)
//      (-1,-1) | ( 0,-1)
float Mesh::corner_height(const BlockId& own, std::int64_t lat, std::int64_t lon) const {
  std::optional<std::uint32_t> first;
  float height = std::numeric_limits<float>::quiet_NaN();
  const auto consider = [&](std::int64_t probe_lat, std::int64_t probe_lon) {
    if (probe_lat < 0 || probe_lat >= dem::kLatTicks) return;
    const auto index = block_at(probe_lat, probe_lon);
    if (!index || (first && is_before(*first, *index))) return;
    if (const auto post_height_m = dem::post_at(*posts_[*index], lat, lon)) {
      first = index;
      height = *post_height_m;
    }
  };
  for (const int dy : {-1, 0})
    for (const int dx : {-1, 0}) consider(lat + dy, lon + dx);
  // At a pole, the loop meets only the blocks beside one meridian. All blocks around the pole hold the same post.
  if (lat == 0 || lat == dem::kLatTicks) {
    const auto index = index_.find(own);
    height = dem::post_at(*posts_[index->second], lat, lon).value_or(height);
  }
  return height;
}

std::size_t Mesh::bytes() const {
  std::size_t sum = sizeof(Mesh);
  for (const auto& b : blocks_) sum += b->bytes();
  return sum;
}

}  // namespace selenograph::engine
