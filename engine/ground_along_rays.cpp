#include "engine/ground_along_rays.h"

#include <fmt/format.h>

#include <algorithm>

#include "dem/detail/detail.h"
#include "dem/support/error.h"
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

}  // namespace

GroundAlongRays::GroundAlongRays(const char* a_ray, FrameRequest scenery, const dem::Terrain& terrain,
                                 RenderCache& kept, const StopToken& stop)
    : a_ray_(a_ray), scenery_(std::move(scenery)), objects_(scenery_), terrain_(terrain), kept_(kept), stop_(stop) {
  if (terrain.detail() && !terrain.detail()->rocks().empty()) rocks_.emplace(terrain);
}

std::unique_ptr<GroundAlongRays::Part> GroundAlongRays::along(const std::vector<RayCone>& rays, bool last) {
  // A scene in use can't be evicted: one that alone is over the budget is refused before it is built.
  const std::size_t of_block = scene_bytes_of({.level = dem::kMaxLevel}, Visibility::raytrace);
  const std::size_t most = std::min(kMaxBlocks, kept_.capacity() / of_block);
  const double above_m = rocks_ ? rocks_->largest_m() : 0;
  const auto met = select_for_rays(terrain_, rays, last ? most : most / 4, stop_, above_m);
  auto rocks = met ? rocks_along(rays, *met) : std::nullopt;
  if (!rocks && last)
    throw TooMuchTerrain(
        fmt::format("{} runs along more terrain than the {} MB for scenes hold", a_ray_, kept_.capacity() >> 20),
        "rays");
  if (!rocks || (!last && far_apart(*rocks))) return nullptr;
  std::vector<dem::BlockId> blocks;
  for (const BlockOnRays& block : *met) blocks.push_back(block.id);
  const SceneContent content{blocks, anchor_for(rays[0].origin_m, rays[0].direction), Visibility::raytrace, &terrain_};
  return std::unique_ptr<Part>(
      new Part{kept_.scene(content, stop_), SceneryOnGround(objects_, scenery_, std::move(*rocks), stop_)});
}

std::optional<std::vector<dem::RockFeature>> GroundAlongRays::rocks_along(const std::vector<RayCone>& rays,
                                                                          const std::vector<BlockOnRays>& blocks) {
  if (!rocks_) return std::vector<dem::RockFeature>();
  return rocks_->along(rays, blocks, stop_);
}

}  // namespace selenograph::engine
