// Splits blocks until neighbours differ by at most one level.

#include "dem/detail/detailed_terrain.h"
#include "dem/posts/level_borders.h"
#include "engine/scene/view_selector.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

}  // namespace

const BlockId* ViewSelector::covering(dem::Tick lat, dem::Tick lon, int level) const {
  for (int n = level; n >= coarsest_level_; --n)
    if (const auto found = chosen_.find(dem::block_at(n, lat, lon)); found != chosen_.end()) return &*found;
  return nullptr;
}

bool ViewSelector::edge_follows(const BlockId& id, const BlockId& neighbour, const NeighbourProbe& probe) const {
  if (neighbour.level >= id.level || !in_view_.contains(id) || in_view_.contains(neighbour)) return false;
  // Reduce the block's extent to the row or column of quads along that side, or to the quad at that corner, as one quad
  // of that size.
  dem::BlockExtent edge = dem::extent_of(id);
  const dem::Tick quads = std::exchange(edge.quads, 1);
  if (probe.north > 0) edge.lat0 += (quads - 1) * edge.lat_step;
  if (probe.east > 0) edge.lon0 += (quads - 1) * edge.lon_step;
  if (probe.north == 0) edge.lat_step *= quads;
  if (probe.east == 0) edge.lon_step *= quads;
  const dem::NodeInfo info = terrain_.node(id, stop_);
  return may_be_visible(bounds_over(edge, static_cast<double>(info.min_m), static_cast<double>(info.max_m)));
}

bool ViewSelector::shows_coarser_layer(const BlockId& neighbour, const BlockId& id) const {
  if (terrain_.detailed()) return false;
  const int posts = terrain_.posts_level(neighbour);
  return neighbour.level >= posts && posts < terrain_.posts_level(id);
}

bool ViewSelector::must_split(const BlockId& neighbour, const BlockId& id, const NeighbourProbe& probe) const {
  const int levels_apart = id.level - neighbour.level;
  if (levels_apart > 1 && (levels_apart > dem::kMaxLevelsApart || !shows_coarser_layer(neighbour, id))) return true;
  return edge_follows(id, neighbour, probe) && exceeds_target(neighbour, errors_of(neighbour), in_view_.at(id));
}

const BlockId* ViewSelector::unbalanced_neighbour(const BlockId& id, const NeighbourProbe& probe) const {
  const BlockId* neighbour = covering(probe.lat, probe.lon, id.level);
  return neighbour && must_split(*neighbour, id, probe) ? neighbour : nullptr;
}

// The normals of the level that shows all octaves have no further one, which those of the level above it show, too.
bool ViewSelector::may_soften(const BlockId& id) const {
  return dem::has_detail(terrain_, id) && id.level < terrain_.detailed()->detail().finest_level() &&
         in_view_.contains(id);
}

Corners ViewSelector::corners_at_coarser(const BlockId& id) const {
  // A coarser block beyond a side softens both corners of that side; one beyond a corner only that corner.
  Corners corners = 0;
  if (!may_soften(id)) return 0;
  for_each_neighbour(id, [&](const NeighbourProbe& probe) {
    const BlockId* neighbour = covering(probe.lat, probe.lon, id.level);
    if (!neighbour || neighbour->level == id.level || !in_view_.contains(*neighbour)) return;
    // Leave out the corners on the opposite side: one of their signs opposes the probe's.
    for (int corner = 0; corner < kCorners; ++corner) {
      const int north = corner / 2 == 0 ? -1 : 1, east = corner % 2 == 0 ? -1 : 1;
      if (probe.north != -north && probe.east != -east) corners = raised(corners, corner, kSoftBlocks);
    }
  });
  return corners;
}

void ViewSelector::find_coarser_neighbours() {
  if (!terrain_.detailed()) return;
  const std::vector<BlockId>& blocks = result_.blocks;
  std::vector<Corners> corners(blocks.size());
  in_parallel_pieces(blocks.size(), 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) corners[i] = corners_at_coarser(blocks[i]);
  });
  if (std::all_of(corners.begin(), corners.end(), [](Corners c) { return c == 0; })) return;
  spread(blocks, corners);
  result_.soft_corners = std::move(corners);
}

// Spreads the shares from block to block: from a corner to the others of a block they fall by one. The last pass only
// gives all blocks at a corner the same share.
void ViewSelector::spread(const std::vector<BlockId>& blocks, std::vector<Corners>& corners) const {
  std::unordered_map<BlockId, int, dem::BlockIdHash> share_of;  // by level, and row and column of the corner
  const auto visit_corners = [](const BlockId& id, const auto& visit) {
    const dem::BlockExtent e = dem::extent_of(id);
    const dem::Tick side = e.quads * e.lat_step;
    for (int corner = 0; corner < kCorners; ++corner) {
      const dem::Tick lat = corner / 2 == 0 ? e.lat0 : e.lat1(), lon = corner % 2 == 0 ? e.lon0 : e.lon1();
      visit(corner, BlockId{id.level, dem::steps_in(lat, side), dem::steps_in(dem::wrap_lon(lon), side)});
    }
  };
  const auto record = [&](std::size_t i) {
    visit_corners(blocks[i], [&](int corner, const BlockId& position) {
      int& share = share_of[position];
      share = std::max(share, share_at(corners[i], corner));
    });
  };
  for (std::size_t i = 0; i < blocks.size(); ++i)
    if (corners[i] != 0) record(i);
  for (int pass = 1; pass <= kSoftBlocks; ++pass)
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      Corners shares = corners[i];
      int largest = 0;
      visit_corners(blocks[i], [&](int corner, const BlockId& position) {
        const auto found = share_of.find(position);
        if (found == share_of.end()) return;
        shares = raised(shares, corner, found->second);
        largest = std::max(largest, found->second);
      });
      for (int corner = 0; pass < kSoftBlocks && corner < kCorners; ++corner)
        shares = raised(shares, corner, largest - 1);
      if (shares == corners[i] || !may_soften(blocks[i])) continue;
      corners[i] = shares;
      record(i);
    }
}

void ViewSelector::balance() {
  for (const VisibleBlock& block : visible_blocks_) in_view_[block.id] = block.pixels_per_metre;
  coarsest_level_ = dem::kMaxLevel;
  for (const BlockId& id : chosen_) coarsest_level_ = std::min(coarsest_level_, id.level);
  // Start with the blocks that are out of balance. The others stay balanced: their neighbours only become finer.
  const std::vector<BlockId> blocks(chosen_.begin(), chosen_.end());
  std::vector<BlockId> todo = gathered_in_parallel<BlockId>(blocks.size(), 64, [&](std::size_t i, auto& unbalanced) {
    bool is_balanced = true;
    for_each_neighbour(blocks[i], [&](const NeighbourProbe& probe) {
      is_balanced = is_balanced && !unbalanced_neighbour(blocks[i], probe);
    });
    if (!is_balanced) unbalanced.push_back(blocks[i]);
  });
  std::sort(todo.begin(), todo.end());
  check(chosen_.size(), stop_);
  while (!todo.empty()) {
    const BlockId id = todo.back();
    todo.pop_back();
    if (!chosen_.contains(id)) continue;
    for_each_neighbour(id, [&](const NeighbourProbe& probe) {
      while (const BlockId* neighbour = unbalanced_neighbour(id, probe)) split(*neighbour, todo);
    });
    check(chosen_.size(), stop_);
  }
}

// Replaces a block by its children, which inherit its pixels per metre, and appends them to `todo`.
void ViewSelector::split(const BlockId id, std::vector<BlockId>& todo) {
  const auto visible = in_view_.find(id);
  const double pixels_per_metre = visible == in_view_.end() ? 0 : visible->second;
  chosen_.erase(id);
  count_detail(id, -1);
  const std::vector<BlockId> children = dem::children_of(id);
  std::vector<std::optional<BoundedNode>> nodes(children.size());
  const auto find_node = [&](std::size_t i) { nodes[i] = bounded_node(terrain_, children[i], stop_); };
  if (dem::has_detail(terrain_, children.front()))
    in_parallel(children.size(), find_node);
  else
    for (std::size_t i = 0; i < children.size(); ++i) find_node(i);
  for (std::size_t i = 0; i < children.size(); ++i) {
    const BlockId& child = children[i];
    const std::optional<BoundedNode>& node = nodes[i];
    if (!node) continue;
    choose(child, node->info.max_m);
    todo.push_back(child);
    if (pixels_per_metre > 0) in_view_[child] = pixels_per_metre;
  }
}

}  // namespace selenograph::engine
