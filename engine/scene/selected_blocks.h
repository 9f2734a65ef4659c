// What selection answers, and what it has to keep to.
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "dem/terrain/terrain.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

struct Selection {
  std::vector<dem::BlockId> blocks;  // sorted; neighbouring levels differ by at most one
  double error_px = 0, error_m = 0;  // bounds over the blocks in view
  double detail_error_px = 0;        // of that, what the terrain's detail adds
  double detail_limit_px = 0;        // Accuracy::max_detail_error_px, or what it gave way to; 0: there is no detail
  double shadow_error_px = 0;        // bound on the displacement of shadow edges on level ground
  double shadow_limit_px = 0;        // Accuracy::max_shadow_error_px, or what it gave way to
  double min_spacing_m = 0, max_spacing_m = 0;
  double highest_m = 0;                      // no block reaches higher
  std::vector<dem::SourceIndex> replaced{};  // unusable files that something in it or in view lacks; ascending
};

// What a scene holds of a block, about: its vertices as float for the z-buffer, with those of the mesh where its border
// is another than the posts', or Embree's 15 bytes a triangle; the posts are the terrain cache's. (Automatic visibility
// takes rays for small frames alone.) Coarse levels have fewer quads: the whole Moon from afar is thousands of small
// blocks.
inline std::size_t scene_bytes_of(const dem::BlockId& id, Visibility visibility) {
  const auto quads = static_cast<std::size_t>(dem::quads_per_side(id.level));
  const std::size_t vertices = (quads + 1) * (quads + 1);
  return 2 * vertices + (visibility == Visibility::raytrace ? 2 * quads * quads * 15 : 22 * vertices);
}

struct SceneRoom {
  std::size_t bytes = std::numeric_limits<std::size_t>::max();
  Visibility visibility = Visibility::automatic;  // of the scene that it is for
};

// Past this many blocks (a million quads per 256) a request is refused: TooMuchTerrain.
inline constexpr std::size_t kMaxBlocks = 6000;

// What isn't terrain but receives its shadows.
struct Ball {
  Vec3 centre_m;
  double radius_m;
};

}  // namespace selenograph::engine
