#include "engine/scene/ray_selection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "engine/scene/known_nodes.h"
#include "engine/scene/root_groups.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

// Blocks beside a ray are needed, too: the heights on a block's edge may be its neighbour's, which begins a quad from
// the ray.
double beside_m(int level) { return 1.5 * dem::post_spacing_m(level); }

// Whether a ray passes through a node, or a quad of its level beside it: within its ball it must come below the highest
// height. A cone's rays pass within its width of its axis, which is that at the ball's far side: as far from the axis
// they may meet the ball, and as much lower they may come. From far away a difference of squares would be rounded to
// more than a block.
bool may_meet(const RayCone& ray, const NodeBounds& b, double above_m, int level) {
  const Vec3 to = b.centre - ray.origin_m;
  const double ball_m = b.radius_m + above_m + beside_m(level), along = to.dot(ray.direction),
               off2 = (to - along * ray.direction).squaredNorm(), far_m = std::max(0.0, along + ball_m + ray.radius_m),
               width_m = ray.one() ? 0 : ray.radius_m + far_m * ray.slope, reach = ball_m + width_m,
               reach2 = reach * reach;
  if (off2 > reach2) return false;
  const double half = std::sqrt(reach2 - off2), t0 = std::max(0.0, along - half), t1 = std::min(along + half, ray.to_m);
  if (t1 < t0) return false;
  const double closest = std::clamp(-ray.origin_m.dot(ray.direction), t0, t1);
  return (ray.origin_m + closest * ray.direction).norm() - width_m <=
         kMoonRadius_m + b.high_m + b.bulge_m + 1 + above_m;
}

// False once there are too many.
bool follow(const dem::Terrain& terrain, const std::vector<RayCone>& rays, const std::vector<std::size_t>& some,
            const BlockId& id, std::size_t max_blocks, double above_m, std::vector<BlockOnRays>& out,
            const StopToken& stop) {
  stop.check();
  const bool worth_asking = may_matter(terrain, id, stop, [&](const NodeBounds& b) {
    return std::any_of(some.begin(), some.end(),
                       [&](std::size_t i) { return may_meet(rays[i], b, above_m, id.level); });
  });
  if (!worth_asking) return true;
  const auto node = known(terrain, id, stop);
  if (!node) return true;
  std::vector<std::size_t> meeting;
  for (const std::size_t i : some)
    if (may_meet(rays[i], node->bounds, above_m, id.level)) meeting.push_back(i);
  if (meeting.empty()) return true;
  if (id.level < terrain.finest_level(id)) {
    const std::vector<BlockId> children = dem::children_of(id);
    return std::all_of(children.begin(), children.end(), [&](const BlockId& child) {
      return follow(terrain, rays, meeting, child, max_blocks, above_m, out, stop);
    });
  }
  out.push_back({id, static_cast<double>(node->info.min_m), static_cast<double>(node->info.max_m), std::move(meeting)});
  return out.size() <= max_blocks;
}

}  // namespace

double range_below_terrain_m(const RayCone& ray) {
  const double closest = -ray.origin_m.dot(ray.direction), width_m = ray.one() ? 0 : ray.radius_m + closest * ray.slope,
               deep_m = dem::kCoreRadius_m - width_m,
               inside = deep_m * std::abs(deep_m) - (ray.origin_m + closest * ray.direction).squaredNorm();
  const double range_m = inside > 0 && closest > 0 ? closest - std::sqrt(inside) : -1;
  return range_m > 0 ? range_m : std::numeric_limits<double>::infinity();
}

std::optional<std::vector<BlockOnRays>> select_for_rays(const dem::Terrain& terrain, const std::vector<RayCone>& rays,
                                                        std::size_t max_blocks, const StopToken& stop, double above_m) {
  std::vector<BlockOnRays> blocks;
  std::vector<std::size_t> all(rays.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
  std::vector<BlockId> near;
  for (const RootGroup& group : root_groups())
    if (std::any_of(rays.begin(), rays.end(),
                    [&](const auto& ray) { return may_meet(ray, group.bounds, above_m, dem::kRootLevel); }))
      for_each_root(terrain, group, [&](const BlockId& id) { near.push_back(id); });
  std::sort(near.begin(), near.end());
  for (const BlockId& id : near)
    if (!follow(terrain, rays, all, id, max_blocks, above_m, blocks, stop)) return std::nullopt;
  std::sort(blocks.begin(), blocks.end(), [](const BlockOnRays& a, const BlockOnRays& b) { return a.id < b.id; });
  return blocks;
}

}  // namespace selenograph::engine
