#include "engine/selection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <unordered_set>

#include "dem/error.h"
#include "engine/light_grid.h"
#include "engine/node_bounds.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;
using Chosen = std::unordered_set<BlockId, dem::BlockIdHash>;

struct Known {
  dem::NodeInfo info;
  NodeBounds bounds;
};

// Heights of a node; lunar relief's own bounds where the true ones would cost building everything beneath.
std::optional<Known> known(const dem::Terrain& terrain, const BlockId& id) {
  if (!terrain.has_data(id)) return std::nullopt;
  dem::NodeInfo info{0, dem::kLowestRelief_m, dem::kHighestRelief_m, false};
  if (terrain.node_is_cheap(id)) info = terrain.node(id);
  if (info.empty) return std::nullopt;
  return Known{info, bounds_of(id, static_cast<double>(info.min_m), static_cast<double>(info.max_m))};
}

void check(const std::size_t blocks, const StopToken& stop) {
  if (stop.stopped()) throw Cancelled();
  if (blocks > kMaxBlocks)
    throw std::invalid_argument(
        "the view needs more terrain than fits: ask for a larger max_error_px, a narrower field of view or a higher "
        "camera");
}

class ViewSelector {
 public:
  ViewSelector(const dem::Terrain& terrain, const View& view, double max_error_px, const StopToken& stop)
      : terrain_(terrain), view_(view), max_error_px_(max_error_px), stop_(stop) {
    result_.min_spacing_m = std::numeric_limits<double>::infinity();
  }

  Selection select(const Sun* sun) {
    for (const BlockId& id : terrain_.roots()) see(id);
    if (sun) add_casters(sun->direction);
    balance();
    result_.blocks.assign(chosen_.begin(), chosen_.end());
    std::sort(result_.blocks.begin(), result_.blocks.end());
    if (in_view_.empty()) result_.min_spacing_m = 0;
    return std::move(result_);
  }

 private:
  struct InView {
    NodeBounds bounds;
    double pixels_per_metre;
  };

  void see(const BlockId& id) {
    check(chosen_.size(), stop_);
    const auto node = known(terrain_, id);
    if (!node) return;
    if (!view_.may_see(node->bounds.centre, node->bounds.radius_m) || below_horizon(view_.position(), node->bounds)) {
      out_of_view_.push_back(id);
      return;
    }
    const double sharpness =
        view_.pixels_per_metre(node->bounds.centre, node->bounds.radius_m, node->bounds.high_m + node->bounds.bulge_m);
    if (refine(id, sharpness)) {
      for (const BlockId& child : dem::children_of(id)) see(child);
      return;
    }
    choose(id, node->info);
    in_view_.push_back({node->bounds, sharpness});
    // The finest surface is what errors are measured to: it has none.
    const double error =
        id.level >= terrain_.finest_level(id) ? 0 : terrain_.node(id).error_m + dem::chord_sag_m(id.level);
    const double spacing = dem::post_spacing_m(id.level);
    result_.error_m = std::max(result_.error_m, error);
    result_.error_px = std::max(result_.error_px, error * sharpness);
    result_.min_spacing_m = std::min(result_.min_spacing_m, spacing);
    result_.max_spacing_m = std::max(result_.max_spacing_m, spacing);
  }

  bool refine(const BlockId& id, double pixels_per_metre) const {
    if (id.level >= terrain_.finest_level(id)) return false;
    if (max_error_px_ == 0) return true;
    const bool coarser_than_posts = id.level < terrain_.posts_level(id);
    if (coarser_than_posts && dem::post_spacing_m(id.level) * pixels_per_metre > 2 * max_error_px_) return true;
    if (dem::chord_sag_m(id.level) * pixels_per_metre > max_error_px_) return true;
    return (terrain_.node(id).error_m + dem::chord_sag_m(id.level)) * pixels_per_metre > max_error_px_;
  }

  void choose(const BlockId& id, const dem::NodeInfo& info) {
    chosen_.insert(id);
    result_.highest_m = std::max(result_.highest_m, static_cast<double>(info.max_m));
  }

  void add_casters(const Vec3& sun) {
    LightGrid grid(sun);
    for (const InView& v : in_view_) grid.add_receiver(v.bounds, v.pixels_per_metre);
    grid.finish();
    for (const BlockId& id : out_of_view_) cast(id, grid);
  }

  void cast(const BlockId& id, const LightGrid& grid) {
    check(chosen_.size(), stop_);
    const auto node = known(terrain_, id);
    if (!node) return;
    const double sharpness = grid.shaded_pixels_per_metre(node->bounds);
    if (sharpness == 0) return;
    const bool finest = id.level >= terrain_.finest_level(id);
    // Large blocks overlap much that they don't shade: they are split until their bounds mean something.
    const bool coarse = id.level < dem::kRootLevel + 1 && !finest;
    if (coarse || (!finest && (max_error_px_ == 0 ||
                               (terrain_.node(id).error_m + dem::chord_sag_m(id.level)) * sharpness > max_error_px_))) {
      for (const BlockId& child : dem::children_of(id)) cast(child, grid);
      return;
    }
    choose(id, node->info);
  }

  // The chosen block that holds a place, at `level` or coarser.
  const BlockId* covering(std::int32_t lat, std::int32_t lon, int level) const {
    for (int n = level; n >= 0; --n)
      if (const auto found = chosen_.find(dem::block_at(n, lat, lon)); found != chosen_.end()) return &*found;
    return nullptr;
  }

  // Splits blocks until neighbours differ by at most one level, so that edges join vertex by vertex.
  void balance() {
    std::vector<BlockId> todo(chosen_.begin(), chosen_.end());
    std::sort(todo.begin(), todo.end());
    while (!todo.empty()) {
      const BlockId id = todo.back();
      todo.pop_back();
      if (!chosen_.contains(id)) continue;
      const dem::BlockExtent e = dem::extent_of(id);
      const auto look = [&](std::int64_t lat, std::int64_t lon) {
        if (lat < 0 || lat >= dem::kLatTicks) return;
        const std::int32_t y = static_cast<std::int32_t>(lat), x = dem::wrap_lon(lon);
        for (const BlockId* wide = covering(y, x, id.level); wide && wide->level < id.level - 1;
             wide = covering(y, x, id.level)) {
          const BlockId split = *wide;
          chosen_.erase(split);
          for (const BlockId& child : dem::children_of(split))
            if (const auto node = known(terrain_, child)) choose(child, node->info), todo.push_back(child);
        }
      };
      const std::int64_t south = e.lat0 - 1, north = e.lat1(), west = std::int64_t{e.lon0} - 1, east = e.lon1();
      const std::int64_t mid_lat = (e.lat0 + e.lat1()) / 2, mid_lon = (std::int64_t{e.lon0} + e.lon1()) / 2;
      for (const std::int64_t lat : {south, mid_lat, north})
        for (const std::int64_t lon : {west, mid_lon, east})
          if (lat != mid_lat || lon != mid_lon) look(lat, lon);
      check(chosen_.size(), stop_);
    }
  }

  const dem::Terrain& terrain_;
  const View& view_;
  double max_error_px_;
  const StopToken& stop_;
  Chosen chosen_;
  std::vector<InView> in_view_;
  std::vector<BlockId> out_of_view_;
  Selection result_;
};

// Whether a ray passes through a node: within its ball it must come below the highest and reach above the lowest
// height.
bool may_meet(const Ray& ray, const NodeBounds& b) {
  const Vec3 to = b.centre - ray.origin_m;
  const double along = to.dot(ray.direction), off2 = to.squaredNorm() - along * along, reach2 = b.radius_m * b.radius_m;
  if (off2 > reach2) return false;
  const double half = std::sqrt(reach2 - off2), t0 = std::max(0.0, along - half), t1 = along + half;
  if (t1 < 0) return false;
  const double closest = std::clamp(-ray.origin_m.dot(ray.direction), t0, t1);
  return (ray.origin_m + closest * ray.direction).norm() <= kMoonRadius_m + b.high_m + b.bulge_m + 1;
}

// False once there are too many.
bool follow(const dem::Terrain& terrain, const std::vector<Ray>& rays, const std::vector<std::size_t>& some,
            const BlockId& id, std::size_t max_blocks, Selection& out, const StopToken& stop) {
  if (stop.stopped()) throw Cancelled();
  const auto node = known(terrain, id);
  if (!node) return true;
  std::vector<std::size_t> meeting;
  for (const std::size_t i : some)
    if (may_meet(rays[i], node->bounds)) meeting.push_back(i);
  if (meeting.empty()) return true;
  if (id.level < terrain.finest_level(id)) {
    const std::vector<BlockId> children = dem::children_of(id);
    return std::all_of(children.begin(), children.end(), [&](const BlockId& child) {
      return follow(terrain, rays, meeting, child, max_blocks, out, stop);
    });
  }
  out.blocks.push_back(id);
  out.highest_m = std::max(out.highest_m, static_cast<double>(node->info.max_m));
  return out.blocks.size() <= max_blocks;
}

}  // namespace

Selection select_for_view(const dem::Terrain& terrain, const View& view, const Sun* sun, double max_error_px,
                          const StopToken& stop) {
  return ViewSelector(terrain, view, max_error_px, stop).select(sun);
}

std::optional<Selection> select_for_rays(const dem::Terrain& terrain, const std::vector<Ray>& rays,
                                         std::size_t max_blocks, const StopToken& stop) {
  Selection selection;
  std::vector<std::size_t> all(rays.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
  for (const BlockId& id : terrain.roots())
    if (!follow(terrain, rays, all, id, max_blocks, selection, stop)) return std::nullopt;
  std::sort(selection.blocks.begin(), selection.blocks.end());
  return selection;
}

}  // namespace selenograph::engine
