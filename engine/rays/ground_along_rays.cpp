#include "engine/rays/ground_along_rays.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/error.h"
#include "dem/detail/detailed_terrain.h"
#include "engine/scene/anchor.h"
#include "engine/scene/ray_selection.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {
namespace {

// Returns whether the rocks span so much ground that float coordinates, relative to their centre, would round too much.
bool are_far_apart(const std::vector<dem::RockFeature>& rocks) {
  constexpr double kFar_m = 20e3;
  return std::any_of(rocks.begin(), rocks.end(), [&](const dem::RockFeature& rock) {
    return (rock.position_m - rocks.front().position_m).norm() > kFar_m;
  });
}

// Replaces runs of neighbouring rays by cones around them, where those are narrow: terrain is selected per cone, which
// takes a fraction of the time of a selection per ray.
std::vector<RayCone> bundle(const std::vector<RayCone>& rays) {
  constexpr std::size_t kRun = 64, kMinRays = 1024;
  constexpr double kMaxSlope = 0.02, kMaxRadius_m = 10;
  if (rays.size() < kMinRays ||
      !std::all_of(rays.begin(), rays.end(), [](const RayCone& ray) { return ray.is_single_ray(); }))
    return rays;
  std::vector<RayCone> out;
  for (std::size_t first = 0; first < rays.size(); first += kRun) {
    const std::span<const RayCone> run(&rays[first], std::min(kRun, rays.size() - first));
    RayCone cone{Vec3::zero(), Vec3::zero()};
    for (const RayCone& ray : run) {
      cone.origin_m += ray.origin_m / static_cast<double>(run.size());
      cone.direction += ray.direction;
    }
    cone.direction.normalize();
    double sine = 0, farthest_m = 0;
    for (const RayCone& ray : run) {
      farthest_m = std::max(farthest_m, ray.to_m);
      cone.radius_m = std::max(cone.radius_m, (ray.origin_m - cone.origin_m).norm());
      // Add 1 for a ray that points backwards: its sine alone would look narrow.
      sine = std::max(sine, ray.direction.cross(cone.direction).norm() + (ray.direction.dot(cone.direction) < 0));
    }
    // Widen the cone by more than the rounding of its axis.
    cone.radius_m += 1e-6;
    cone.slope = 1.01 * sine + 1e-7;
    cone.to_m = farthest_m + cone.radius_m;
    if (cone.slope < kMaxSlope && cone.radius_m < kMaxRadius_m)
      out.push_back(cone);
    else
      out.insert(out.end(), run.begin(), run.end());
  }
  return out;
}

}  // namespace

// Up to the posts' surface a ray's reach grows by factors of four; within the last quarter it jumps past the surface.
double next_reach_m(double reach_m, double posts_m) {
  constexpr double kFirst_m = 16, kBeyond_m = 8, kStep = 4, kFar_m = 1e5;
  constexpr double kEnd_m = std::numeric_limits<double>::infinity();
  // Past the posts' surface: move on in growing steps from there.
  if (reach_m > posts_m) return reach_m - posts_m < kFar_m ? posts_m + kStep * (reach_m - posts_m) : kEnd_m;
  const double next_m = std::max(kFirst_m, kStep * reach_m);
  if (next_m > 0.75 * posts_m || (next_m > kFar_m && posts_m > 0)) return posts_m + kBeyond_m;
  return next_m > kFar_m ? kEnd_m : next_m;
}

// A rock and the soil against it lie within one diameter of the rock's position (visibility/objects/rock_shapes.h).
RockCells::RockCells(std::span<const dem::RockFeature> rocks) {
  for (const dem::RockFeature& rock : rocks) centre_m_ += rock.position_m / static_cast<double>(rocks.size());
  axes_ = local_axes(centre_m_);
  for (const dem::RockFeature& rock : rocks) {
    const Vec3 at = rock.position_m - centre_m_;
    const double reach_m = rock.rock.diameter_m;
    shell_m_ = std::max(shell_m_, rock.position_m.norm() + reach_m);
    half_side_m_ =
        std::max({half_side_m_, std::abs(at.dot(axes_.east)) + reach_m, std::abs(at.dot(axes_.north)) + reach_m});
  }
  constexpr double kCellsPerRock = 16;
  cells_per_side_ =
      static_cast<int>(std::clamp(std::sqrt(kCellsPerRock * static_cast<double>(rocks.size())), 16.0, 1024.0));
  // Mark the cells that a rock reaches, one row and one column in. Summed up in place, an element then holds the marked
  // cells south-west of it, and the number in a rectangle follows from its four corners.
  const auto row = static_cast<std::size_t>(cells_per_side_) + 1;
  area_sums_.assign(row * row, 0);
  for (const dem::RockFeature& rock : rocks) {
    const Vec3 at = rock.position_m - centre_m_;
    const double x = at.dot(axes_.east), y = at.dot(axes_.north), reach_m = rock.rock.diameter_m;
    for (int j = cell(y - reach_m); j <= cell(y + reach_m); ++j)
      for (int i = cell(x - reach_m); i <= cell(x + reach_m); ++i)
        area_sums_[row * static_cast<std::size_t>(j + 1) + static_cast<std::size_t>(i + 1)] = 1;
  }
  for (std::size_t j = 1; j < row; ++j)
    for (std::size_t i = 1; i < row; ++i)
      area_sums_[row * j + i] +=
          area_sums_[row * j + i - 1] + area_sums_[row * (j - 1) + i] - area_sums_[row * (j - 1) + i - 1];
}

// Returns the cell of a coordinate in the tangent plane, clamped to the square.
int RockCells::cell(double m) const {
  return static_cast<int>(std::clamp((m / half_side_m_ + 1) / 2 * cells_per_side_, 0.0, cells_per_side_ - 1.0));
}

// Counts the marked cells in a rectangle of cells, whose last column and row are x1 and y1.
std::uint32_t RockCells::count_cells_with_rocks(int x0, int y0, int x1, int y1) const {
  const auto at = [&](int x, int y) {
    return area_sums_[static_cast<std::size_t>(y) * static_cast<std::size_t>(cells_per_side_ + 1) +
                      static_cast<std::size_t>(x)];
  };
  return at(x1 + 1, y1 + 1) - at(x0, y1 + 1) - at(x1 + 1, y0) + at(x0, y0);
}

// Counts rocks in the bounding rectangle of the rays' segments from the shell to the terrain.
bool RockCells::may_hit(const Rays& rays, const SurfacePoints& terrain) const {
  constexpr double kRounding_m = 1e-3;
  double west = 1e300, east = -1e300, south = 1e300, north = -1e300;
  for (int i = 0; i < kPacket; ++i) {
    if (!rays.valid[i]) continue;
    const Vec3 o = rays.origin(i), d = rays.direction(i);
    // The ray meets the sphere of radius shell_m_, below which all rocks lie, where a t^2 + 2 b t + c = 0.
    const double a = d.squared_norm(), b = o.dot(d), c = o.squared_norm() - shell_m_ * shell_m_;
    const double discriminant = b * b - a * c;
    if (discriminant < 0) continue;
    const double root = std::sqrt(discriminant), enter_m = std::max(0.0, (-b - root) / a),
                 leave_m = terrain.hit[i] ? terrain.distance[i] : (-b + root) / a;
    if (leave_m < enter_m) continue;
    for (const double t : {enter_m, leave_m}) {
      const Vec3 at = o + t * d - centre_m_;
      const double x = at.dot(axes_.east), y = at.dot(axes_.north);
      west = std::min(west, x);
      east = std::max(east, x);
      south = std::min(south, y);
      north = std::max(north, y);
    }
  }
  if (east + kRounding_m < -half_side_m_ || west - kRounding_m > half_side_m_ || north + kRounding_m < -half_side_m_ ||
      south - kRounding_m > half_side_m_)
    return false;
  return count_cells_with_rocks(cell(west - kRounding_m), cell(south - kRounding_m), cell(east + kRounding_m),
                                cell(north + kRounding_m)) > 0;
}

GroundAlongRays::GroundAlongRays(const char* ray_description, FrameRequest scenery, const RenderContext& context)
    : ray_description_(ray_description), scenery_(std::move(scenery)), objects_(scenery_), context_(context) {
  if (context.terrain.detailed() && !context.terrain.detailed()->detail().rocks().empty())
    rocks_.emplace(context.terrain);
}

int GroundAlongRays::finest_ground(int finest_detail) const {
  if (!context_.terrain.detailed()) return finest_detail;
  return std::min(finest_detail, context_.terrain.detailed()->detail().finest_level());
}

bool GroundAlongRays::may_meet_ground(const std::vector<RayCone>& rays) const {
  constexpr int kCoarseGround = 14;  // blocks 120 m wide: their heights span metres
  const double above_m = rocks_ ? rocks_->largest_m() : 0;
  const auto blocks = select_for_rays(context_.terrain, rays, kMaxBlocks, context_.stop, above_m, kCoarseGround);
  return !blocks || !blocks->empty();
}

std::unique_ptr<GroundAlongRays::GroundScene> GroundAlongRays::build_scene(const std::vector<RayCone>& single_rays,
                                                                           bool indivisible, int finest_detail) {
  const std::vector<RayCone> rays = bundle(single_rays);
  // A scene in use cannot be evicted, so refuse one that alone exceeds the budget before it is built.
  const std::size_t block_bytes = scene_bytes_of({.level = dem::kMaxLevel}, Visibility::raytrace);
  const std::size_t max_blocks = std::min(kMaxBlocks, context_.cache.capacity() / block_bytes);
  // The rays that share a scene share its anchor, which decides how float rounds. A constant limit makes results
  // independent of the service's memory, unless that holds fewer blocks.
  constexpr std::size_t kBlocksOfScene = 900;
  const std::size_t limit = indivisible ? max_blocks : std::min(kBlocksOfScene, max_blocks);
  const auto select = [&](double above_m, int finest_level) {
    return select_for_rays(context_.terrain, rays, limit, context_.stop, above_m, finest_level);
  };
  // Rocks stand on ground within the largest rock's height of a ray. Blocks finer than kFinestWithRocks, 15 m wide,
  // would be too many there: with finer ground, rocks are found by a selection of their own.
  constexpr int kFinestWithRocks = 17;
  const int finest_level = finest_ground(finest_detail);
  const bool separate = rocks_ && finest_level > kFinestWithRocks;
  const auto selected = select(rocks_ && !separate ? rocks_->largest_m() : 0, finest_level);
  const auto with_rocks = separate ? select(rocks_->largest_m(), kFinestWithRocks) : selected;
  auto rocks = selected && with_rocks ? rocks_along(rays, *with_rocks, finest_detail) : std::nullopt;
  if (!rocks && indivisible)
    throw TooMuchTerrain(fmt::format("{} runs along more terrain than the {} MB for scenes hold", ray_description_,
                                     context_.cache.capacity() >> 20),
                         "rays");
  if (!rocks || (!indivisible && are_far_apart(*rocks))) return nullptr;
  std::vector<dem::BlockId> blocks;
  for (const BlockOnRays& block : *selected) blocks.push_back(block.id);
  const Vec3 anchor_m = anchor_for(rays[0].origin_m, rays[0].direction, 0, fine_ground(blocks, context_.terrain));
  const SceneContent content{blocks, anchor_m, Visibility::raytrace, &context_.terrain};
  return std::unique_ptr<GroundScene>(new GroundScene{
      context_.cache.scene(content, context_.stop),
      SceneryOnGround(objects_, scenery_, std::move(*rocks), context_.stop), blocks.empty() && objects_.empty()});
}

// Returns the rocks that the rays may hit; empty if there are too many.
std::optional<std::vector<dem::RockFeature>> GroundAlongRays::rocks_along(const std::vector<RayCone>& rays,
                                                                          const std::vector<BlockOnRays>& blocks,
                                                                          int finest_detail) {
  if (!rocks_) return std::vector<dem::RockFeature>();
  const double left_out_m =
      finest_detail < context_.terrain.detailed()->detail().finest_level() ? dem::post_spacing_m(finest_detail) : 0;
  return rocks_->along(rays, blocks, left_out_m, context_.stop);
}

}  // namespace selenograph::engine
