#include "dem/posts/level_borders.h"
#include "engine/scene/view_selector.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

}  // namespace

const BlockId* ViewSelector::covering(std::int32_t lat, std::int32_t lon, int level) const {
  for (int n = level; n >= coarsest_; --n)
    if (const auto found = chosen_.find(dem::block_at(n, lat, lon)); found != chosen_.end()) return &*found;
  return nullptr;
}

bool ViewSelector::follows(const BlockId& id, const BlockId& neighbour, const Beside& at) const {
  if (neighbour.level >= id.level || !in_view_.contains(id) || in_view_.contains(neighbour)) return false;
  dem::BlockExtent edge = dem::extent_of(id);
  const std::int32_t quads = std::exchange(edge.quads, 1);
  if (at.north > 0) edge.lat0 += (quads - 1) * edge.lat_step;
  if (at.east > 0) edge.lon0 += (quads - 1) * edge.lon_step;
  if (at.north == 0) edge.lat_step *= quads;
  if (at.east == 0) edge.lon_step *= quads;
  const dem::NodeInfo info = terrain_.node(id, stop_);
  return may_see(bounds_over(edge, static_cast<double>(info.min_m), static_cast<double>(info.max_m)));
}

bool ViewSelector::of_coarser_layer(const BlockId& neighbour, const BlockId& id) const {
  if (terrain_.detail()) return false;
  const int posts = terrain_.posts_level(neighbour);
  return neighbour.level >= posts && posts < terrain_.posts_level(id);
}

bool ViewSelector::must_split(const BlockId& neighbour, const BlockId& id, const Beside& at) const {
  const int apart = id.level - neighbour.level;
  if (apart > 1 && (apart > dem::kMostLevelsApart || !of_coarser_layer(neighbour, id))) return true;
  return follows(id, neighbour, at) && errs(neighbour, errors_of(neighbour), in_view_.at(id));
}

bool ViewSelector::must_split_any(const BlockId& id) const {
  bool any = false;
  around(id, [&](const Beside& at) {
    if (any) return;
    const BlockId* coarser = covering(at.lat, at.lon, id.level);
    any = coarser && must_split(*coarser, id, at);
  });
  return any;
}

Corners ViewSelector::coarser_beside(const BlockId& id) const {
  int corners = 0;
  if (!terrain_.has_detail(id) || !in_view_.contains(id)) return 0;
  around(id, [&](const Beside& at) {
    const BlockId* other = covering(at.lat, at.lon, id.level);
    if (!other || other->level == id.level || !in_view_.contains(*other)) return;
    for (int corner = 0; corner < kCorners; ++corner) {
      const int north = corner / 2 == 0 ? -1 : 1, east = corner % 2 == 0 ? -1 : 1;
      if (at.north != -north && at.east != -east) corners |= 1 << corner;
    }
  });
  return static_cast<Corners>(corners);
}

void ViewSelector::find_coarser_beside() {
  if (!terrain_.detail()) return;
  const std::vector<BlockId>& blocks = result_.blocks;
  std::vector<Corners> corners(blocks.size());
  in_parallel_pieces(blocks.size(), 64, [&](std::size_t first, std::size_t past_last) {
    for (std::size_t i = first; i < past_last; ++i) corners[i] = coarser_beside(blocks[i]);
  });
  if (std::any_of(corners.begin(), corners.end(), [](Corners c) { return c != 0; }))
    result_.beside_coarser = std::move(corners);
}

void ViewSelector::balance() {
  for (const Seen& s : seen_) in_view_[s.id] = s.pixels_per_metre;
  coarsest_ = dem::kMaxLevel;
  for (const BlockId& id : chosen_) coarsest_ = std::min(coarsest_, id.level);
  // Most blocks are in balance, and stay so: neighbours only become finer.
  const std::vector<BlockId> all(chosen_.begin(), chosen_.end());
  std::vector<BlockId> todo = gathered_in_parallel<BlockId>(all.size(), 64, [&](std::size_t i, auto& some) {
    if (must_split_any(all[i])) some.push_back(all[i]);
  });
  std::sort(todo.begin(), todo.end());
  check(chosen_.size(), stop_);
  while (!todo.empty()) {
    const BlockId id = todo.back();
    todo.pop_back();
    if (!chosen_.contains(id)) continue;
    around(id, [&](const Beside& at) {
      for (const BlockId* coarser = covering(at.lat, at.lon, id.level); coarser && must_split(*coarser, id, at);
           coarser = covering(at.lat, at.lon, id.level))
        split(*coarser, todo);
    });
    check(chosen_.size(), stop_);
  }
}

void ViewSelector::split(const BlockId id, std::vector<BlockId>& todo) {
  const auto seen = in_view_.find(id);
  const double sharpness = seen == in_view_.end() ? 0 : seen->second;
  chosen_.erase(id);
  count_detail(id, -1);
  const std::vector<BlockId> children = dem::children_of(id);
  std::vector<std::optional<Known>> nodes(children.size());
  const auto look = [&](std::size_t i) { nodes[i] = known(terrain_, children[i], stop_); };
  if (terrain_.has_detail(children.front()))
    in_parallel(children.size(), look);
  else
    for (std::size_t i = 0; i < children.size(); ++i) look(i);
  for (std::size_t i = 0; i < children.size(); ++i) {
    const BlockId& child = children[i];
    const std::optional<Known>& node = nodes[i];
    if (!node) continue;
    choose(child, node->info.max_m);
    todo.push_back(child);
    if (sharpness > 0) in_view_[child] = sharpness;
  }
}

}  // namespace selenograph::engine
