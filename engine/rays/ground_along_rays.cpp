#include "engine/rays/ground_along_rays.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/error.h"
#include "dem/detail/detail.h"
#include "engine/scene/anchor.h"
#include "engine/scene/ray_selection.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {
namespace {

// Float is relative to the rocks' middle.
bool far_apart(const std::vector<dem::RockFeature>& rocks) {
  constexpr double kFar_m = 20e3;
  return std::any_of(rocks.begin(), rocks.end(), [&](const dem::RockFeature& rock) {
    return (rock.position_m - rocks.front().position_m).norm() > kFar_m;
  });
}

// Many rays next to each other look for terrain together: runs of them as cones, where those are narrow.
std::vector<RayCone> bundled(const std::vector<RayCone>& rays) {
  constexpr std::size_t kRun = 64, kMany = 1024;
  constexpr double kNarrow = 0.02, kNear_m = 10;
  if (rays.size() < kMany ||
      !std::all_of(rays.begin(), rays.end(), [](const RayCone& ray) { return ray.is_single_ray(); }))
    return rays;
  std::vector<RayCone> out;
  for (std::size_t first = 0; first < rays.size(); first += kRun) {
    const std::span<const RayCone> run(&rays[first], std::min(kRun, rays.size() - first));
    RayCone cone{Vec3::Zero(), Vec3::Zero()};
    for (const RayCone& ray : run)
      cone.origin_m += ray.origin_m / static_cast<double>(run.size()), cone.direction += ray.direction;
    cone.direction.normalize();
    double sine = 0, farthest_m = 0;
    for (const RayCone& ray : run) {
      farthest_m = std::max(farthest_m, ray.to_m);
      cone.radius_m = std::max(cone.radius_m, (ray.origin_m - cone.origin_m).norm());
      sine = std::max(sine, ray.direction.cross(cone.direction).norm() + (ray.direction.dot(cone.direction) < 0));
    }
    // Some more than rounding.
    cone.radius_m += 1e-6, cone.slope = 1.01 * sine + 1e-7;
    cone.to_m = farthest_m + cone.radius_m;
    if (cone.slope < kNarrow && cone.radius_m < kNear_m)
      out.push_back(cone);
    else
      out.insert(out.end(), run.begin(), run.end());
  }
  return out;
}

}  // namespace

double next_reach_m(double reach_m, double posts_m) {
  constexpr double kFirst_m = 16, kBeyond_m = 8, kStep = 4, kFar_m = 1e5;
  constexpr double kEnd_m = std::numeric_limits<double>::infinity();
  if (reach_m > posts_m) return reach_m - posts_m < kFar_m ? posts_m + kStep * (reach_m - posts_m) : kEnd_m;
  const double next_m = std::max(kFirst_m, kStep * reach_m);
  if (next_m > 0.75 * posts_m || (next_m > kFar_m && posts_m > 0)) return posts_m + kBeyond_m;
  return next_m > kFar_m ? kEnd_m : next_m;
}

// All of a rock and of the soil against it is within a diameter of its position (visibility/objects/rock_shapes.h).
RockCells::RockCells(std::span<const dem::RockFeature> rocks) {
  for (const dem::RockFeature& rock : rocks) middle_ += rock.position_m / static_cast<double>(rocks.size());
  axes_ = local_axes(middle_);
  for (const dem::RockFeature& rock : rocks) {
    const Vec3 at = rock.position_m - middle_;
    const double reach_m = rock.rock.diameter_m;
    shell_m_ = std::max(shell_m_, rock.position_m.norm() + reach_m);
    half_m_ = std::max({half_m_, std::abs(at.dot(axes_.east)) + reach_m, std::abs(at.dot(axes_.north)) + reach_m});
  }
  constexpr double kCellsOfRock = 16;
  side_ = static_cast<int>(std::clamp(std::sqrt(kCellsOfRock * static_cast<double>(rocks.size())), 16.0, 1024.0));
  const auto row = static_cast<std::size_t>(side_) + 1;
  sums_.assign(row * row, 0);
  for (const dem::RockFeature& rock : rocks) {
    const Vec3 at = rock.position_m - middle_;
    const double x = at.dot(axes_.east), y = at.dot(axes_.north), reach_m = rock.rock.diameter_m;
    for (int j = cell(y - reach_m); j <= cell(y + reach_m); ++j)
      for (int i = cell(x - reach_m); i <= cell(x + reach_m); ++i)
        sums_[row * static_cast<std::size_t>(j + 1) + static_cast<std::size_t>(i + 1)] = 1;
  }
  for (std::size_t j = 1; j < row; ++j)
    for (std::size_t i = 1; i < row; ++i)
      sums_[row * j + i] += sums_[row * j + i - 1] + sums_[row * (j - 1) + i] - sums_[row * (j - 1) + i - 1];
}

int RockCells::cell(double m) const {
  return static_cast<int>(std::clamp((m / half_m_ + 1) / 2 * side_, 0.0, side_ - 1.0));
}

std::uint32_t RockCells::number_in(int x0, int y0, int x1, int y1) const {
  const auto at = [&](int x, int y) {
    return sums_[static_cast<std::size_t>(y) * static_cast<std::size_t>(side_ + 1) + static_cast<std::size_t>(x)];
  };
  return at(x1 + 1, y1 + 1) - at(x0, y1 + 1) - at(x1 + 1, y0) + at(x0, y0);
}

// The box around the parts of the rays that are within the shell and before the terrain.
bool RockCells::may_meet(const Rays& rays, const SurfacePoints& terrain) const {
  constexpr double kRounding_m = 1e-3;
  double west = 1e300, east = -1e300, south = 1e300, north = -1e300;
  for (int i = 0; i < kPacket; ++i) {
    if (!rays.valid[i]) continue;
    const Vec3 o = rays.origin(i), d = rays.direction(i);
    const double a = d.squaredNorm(), b = o.dot(d), outside = o.squaredNorm() - shell_m_ * shell_m_,
                 root2 = b * b - a * outside;
    if (root2 < 0) continue;
    const double root = std::sqrt(root2), enters = std::max(0.0, (-b - root) / a),
                 leaves = terrain.hit[i] ? terrain.distance[i] : (-b + root) / a;
    if (leaves < enters) continue;
    for (const double t : {enters, leaves}) {
      const Vec3 at = o + t * d - middle_;
      const double x = at.dot(axes_.east), y = at.dot(axes_.north);
      west = std::min(west, x), east = std::max(east, x), south = std::min(south, y), north = std::max(north, y);
    }
  }
  if (east + kRounding_m < -half_m_ || west - kRounding_m > half_m_ || north + kRounding_m < -half_m_ ||
      south - kRounding_m > half_m_)
    return false;
  return number_in(cell(west - kRounding_m), cell(south - kRounding_m), cell(east + kRounding_m),
                   cell(north + kRounding_m)) > 0;
}

GroundAlongRays::GroundAlongRays(const char* a_ray, FrameRequest scenery, const dem::Terrain& terrain,
                                 RenderCache& kept, const StopToken& stop)
    : a_ray_(a_ray), scenery_(std::move(scenery)), objects_(scenery_), terrain_(terrain), kept_(kept), stop_(stop) {
  if (terrain.detail() && !terrain.detail()->rocks().empty()) rocks_.emplace(terrain);
}

std::unique_ptr<GroundAlongRays::Part> GroundAlongRays::along(const std::vector<RayCone>& each, bool last,
                                                              int finest_detail) {
  const std::vector<RayCone> rays = bundled(each);
  // A scene in use can't be evicted: one that alone is over the budget is refused before it is built.
  const std::size_t of_block = scene_bytes_of({.level = dem::kMaxLevel}, Visibility::raytrace);
  const std::size_t most = std::min(kMaxBlocks, kept_.capacity() / of_block);
  // The choice of rays that share a scene decides how float rounds. It does not depend on the service's memory, unless
  // that holds less than this.
  constexpr std::size_t kBlocksOfScene = 900;
  const double above_m = rocks_ ? rocks_->largest_m() : 0;
  const auto met =
      select_for_rays(terrain_, rays, last ? most : std::min(kBlocksOfScene, most), stop_, above_m, finest_detail);
  auto rocks = met ? rocks_along(rays, *met, finest_detail) : std::nullopt;
  if (!rocks && last)
    throw TooMuchTerrain(
        fmt::format("{} runs along more terrain than the {} MB for scenes hold", a_ray_, kept_.capacity() >> 20),
        "rays");
  if (!rocks || (!last && far_apart(*rocks))) return nullptr;
  std::vector<dem::BlockId> blocks;
  for (const BlockOnRays& block : *met) blocks.push_back(block.id);
  const Vec3 anchor_m = anchor_for(rays[0].origin_m, rays[0].direction, 0, fine_ground(blocks, terrain_));
  const SceneContent content{blocks, anchor_m, Visibility::raytrace, &terrain_};
  return std::unique_ptr<Part>(new Part{kept_.scene(content, stop_),
                                        SceneryOnGround(objects_, scenery_, std::move(*rocks), stop_),
                                        blocks.empty() && objects_.empty()});
}

std::optional<std::vector<dem::RockFeature>> GroundAlongRays::rocks_along(const std::vector<RayCone>& rays,
                                                                          const std::vector<BlockOnRays>& blocks,
                                                                          int finest_detail) {
  if (!rocks_) return std::vector<dem::RockFeature>();
  const double left_out_m = finest_detail < terrain_.detail()->finest_level() ? dem::post_spacing_m(finest_detail) : 0;
  return rocks_->along(rays, blocks, left_out_m, stop_);
}

}  // namespace selenograph::engine
