#include "engine/scene/ray_selection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "engine/scene/bounded_nodes.h"
#include "engine/scene/root_groups.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

// Returns the distance from a ray within which blocks are needed: the heights on a block's edge may be its neighbour's,
// which begins a quad from the ray.
double margin_m(int level) { return 1.5 * dem::post_spacing_m(level); }

// Returns true if a ray may pass through a node, or through a quad of its level beside it: within the node's ball it
// must come below the greatest height. A cone's rays stay within its width of the axis, taken at the ball's far side.
// They may hit the ball that far from the axis, and come that much lower. Distances are compared to the axis: from far
// away, a difference of squares would be rounded to more than a block.
bool may_hit(const RayCone& ray, const NodeBounds& b, double above_m, int level) {
  const Vec3 to = b.centre - ray.origin_m;
  const double ball_m = b.radius_m + above_m + margin_m(level);
  const double along_m = to.dot(ray.direction);
  const double off_axis2 = (to - along_m * ray.direction).squared_norm();
  const double far_m = std::max(0.0, along_m + ball_m + ray.radius_m);
  const double width_m = ray.is_single_ray() ? 0 : ray.radius_m + far_m * ray.slope;
  const double reach_m = ball_m + width_m;
  const double reach2 = reach_m * reach_m;
  if (off_axis2 > reach2) return false;
  // The axis is within reach from t0 to t1, and nearest to the Moon's centre at `closest`.
  const double half_chord_m = std::sqrt(reach2 - off_axis2);
  const double t0 = std::max(0.0, along_m - half_chord_m);
  const double t1 = std::min(along_m + half_chord_m, ray.to_m);
  if (t1 < t0) return false;
  const double closest = std::clamp(-ray.origin_m.dot(ray.direction), t0, t1);
  return (ray.origin_m + closest * ray.direction).norm() - width_m <=
         kMoonRadius_m + b.high_m + b.bulge_m + 1 + above_m;
}

class RaySelector {
  using RayIndices = std::vector<std::size_t>;

 public:
  RaySelector(const dem::Terrain& terrain, const std::vector<RayCone>& rays, std::size_t max_blocks, double above_m,
              int finest_detail, const StopToken& stop)
      : terrain_(terrain),
        rays_(rays),
        max_blocks_(max_blocks),
        above_m_(above_m),
        finest_detail_(finest_detail),
        stop_(stop) {}

  // Adds the blocks below a node that candidate rays may hit. Returns false once there are too many. `parent`: null for
  // a root.
  bool visit(const BlockId& id, const RayIndices& candidates, const dem::NodeInfo* parent) {
    stop_.check();
    // Reject a block with detail by bounds that need no block to be made: its parent's heights, then its outline's.
    RayIndices hitting = candidates;
    const bool has_detail = dem::has_detail(terrain_, id);
    if (has_detail && parent && !remove_missing(hitting, id, bounds_within(id, *parent))) return true;
    if (!has_detail &&
        !may_matter(terrain_, id, stop_, [&](const NodeBounds& b) { return any_hits(candidates, id, b); }))
      return true;
    const bool is_final = id.level >= terrain_.finest_level(id) || (has_detail && id.level >= finest_detail_);
    const auto outline = dem::outline(terrain_, id, stop_);
    if (outline && !remove_missing(hitting, id, bounds_within(id, *outline))) return true;
    if (outline && !is_final) return visit_children(id, hitting, *outline);
    const auto node = bounded_node(terrain_, id, stop_);
    if (!node || !remove_missing(hitting, id, node->bounds)) return true;
    if (!is_final) return visit_children(id, hitting, node->info);
    blocks_.push_back(
        {id, static_cast<double>(node->info.min_m), static_cast<double>(node->info.max_m), std::move(hitting)});
    return blocks_.size() <= max_blocks_;
  }

  std::vector<BlockOnRays> sorted_blocks() {
    std::sort(blocks_.begin(), blocks_.end(), [](const BlockOnRays& a, const BlockOnRays& b) { return a.id < b.id; });
    return std::move(blocks_);
  }

 private:
  bool hits(std::size_t ray, const BlockId& id, const NodeBounds& bounds) const {
    return may_hit(rays_[ray], bounds, above_m_, id.level);
  }
  bool any_hits(const RayIndices& candidates, const BlockId& id, const NodeBounds& bounds) const {
    return std::any_of(candidates.begin(), candidates.end(), [&](std::size_t i) { return hits(i, id, bounds); });
  }
  // Removes the rays that miss the bounds. Returns true if any is left.
  bool remove_missing(RayIndices& candidates, const BlockId& id, const NodeBounds& bounds) const {
    std::erase_if(candidates, [&](std::size_t i) { return !hits(i, id, bounds); });
    return !candidates.empty();
  }
  bool visit_children(const BlockId& id, const RayIndices& hitting, const dem::NodeInfo& heights) {
    const std::vector<BlockId> children = dem::children_of(id);
    return std::all_of(children.begin(), children.end(),
                       [&](const BlockId& child) { return visit(child, hitting, &heights); });
  }

  const dem::Terrain& terrain_;
  const std::vector<RayCone>& rays_;
  const std::size_t max_blocks_;
  const double above_m_;
  const int finest_detail_;
  const StopToken& stop_;
  std::vector<BlockOnRays> blocks_;
};

}  // namespace

// Returns the range at which the axis enters a sphere that lies below all terrain by the cone's width there.
double range_below_terrain_m(const RayCone& ray) {
  const double closest = -ray.origin_m.dot(ray.direction);
  const double width_m = ray.is_single_ray() ? 0 : ray.radius_m + closest * ray.slope;
  const double deep_m = dem::kCoreRadius_m - width_m;
  // Square of half the chord in that sphere; negative if the axis misses it, or the cone is wider than the Moon.
  const double half_chord2 = deep_m * std::abs(deep_m) - (ray.origin_m + closest * ray.direction).squared_norm();
  const double range_m = half_chord2 > 0 && closest > 0 ? closest - std::sqrt(half_chord2) : -1;
  return range_m > 0 ? range_m : std::numeric_limits<double>::infinity();
}

std::optional<std::vector<BlockOnRays>> select_for_rays(const dem::Terrain& terrain, const std::vector<RayCone>& rays,
                                                        std::size_t max_blocks, const StopToken& stop, double above_m,
                                                        int finest_detail) {
  RaySelector selector(terrain, rays, max_blocks, above_m, finest_detail, stop);
  std::vector<std::size_t> ray_indices(rays.size());
  for (std::size_t i = 0; i < ray_indices.size(); ++i) ray_indices[i] = i;
  std::vector<BlockId> roots;
  for (const RootGroup& group : root_groups())
    if (std::any_of(rays.begin(), rays.end(),
                    [&](const auto& ray) { return may_hit(ray, group.bounds, above_m, dem::kRootLevel); }))
      for_each_root(terrain, group, [&](const BlockId& id) { roots.push_back(id); });
  std::sort(roots.begin(), roots.end());
  for (const BlockId& id : roots)
    if (!selector.visit(id, ray_indices, nullptr)) return std::nullopt;
  return selector.sorted_blocks();
}

}  // namespace selenograph::engine
