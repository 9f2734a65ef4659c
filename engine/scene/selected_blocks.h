// Result of the selection, and its limits.
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "dem/terrain/terrain.h"
#include "engine/frame/request.h"
#include "engine/scene/soft_normals.h"

namespace selenograph::engine {

struct Selection {
  // Sorted by id. Levels of neighbours differ by at most one, beside a coarser layer's posts by at most
  // kMaxLevelsApart.
  std::vector<dem::BlockId> blocks;
  double error_px = 0, error_m = 0;  // upper bounds over the blocks in view
  // 99th percentile of the error over the pixels, as expected (expected_error.h).
  double expected_error_px = 0, expected_error_m = 0;
  double detail_error_px = 0;  // the share of error_px that comes from detail
  double detail_limit_px = 0;  // Accuracy::max_detail_error_px as used; 0: no detail
  double shadow_error_px = 0;  // upper bound for shadow edges on level ground
  double shadow_limit_px = 0;  // Accuracy::max_shadow_error_px as used
  double min_spacing_m = 0, max_spacing_m = 0;
  // Upper bounds over the blocks in view: pixels per metre, and post spacing in pixels.
  double max_pixels_per_metre = 0, max_spacing_px = 0;
  double highest_m = 0;                      // upper bound on the height of all blocks
  std::vector<dem::SourceIndex> replaced{};  // unusable files replaced by coarser data; ascending
  // Per block, the shares of smoothed normals at its corners (soft_normals.h); empty if there are none. Only for
  // terrain with detail.
  std::vector<Corners> soft_corners{};
};

// Returns the approximate memory of a block in a scene: its vertices as float for the z-buffer, plus those of the mesh
// if its border differs from the posts', or Embree's 15 bytes per triangle. Posts belong to the terrain cache.
// (Automatic visibility uses ray tracing for small frames only.) Coarse levels have fewer quads, so the whole Moon from
// afar is thousands of small blocks.
inline std::size_t scene_bytes_of(const dem::BlockId& id, Visibility visibility) {
  const auto quads = static_cast<std::size_t>(dem::quads_per_side(id.level));
  const std::size_t vertices = (quads + 1) * (quads + 1);
  return 2 * vertices + (visibility == Visibility::raytrace ? 2 * quads * quads * 15 : 22 * vertices);
}

// Memory that a scene may use.
struct SceneBudget {
  std::size_t bytes = std::numeric_limits<std::size_t>::max();
  Visibility visibility = Visibility::automatic;  // visibility algorithm of the scene
};

// Limit on blocks; more are refused with TooMuchTerrain. The whole Moon in 2048 x 2048 pixels, over posts 0.06 degrees
// apart, has 8900. It only ends a hopeless traversal early: SceneBudget limits the memory.
inline constexpr std::size_t kMaxBlocks = 16000;

// Bounding sphere of an object that receives shadows.
struct Ball {
  Vec3 centre_m;
  double radius_m;
};

}  // namespace selenograph::engine
