// Which blocks a frame needs, and how fine: level of detail by error, casters outside the view.
//
// A function of the request and the terrain only, never of what happens to be loaded: the same request selects the same
// blocks. A block in view is refined until its posts are at most 2 max_error_px pixels apart and its vertical error (to
// the finest surface, plus the chord's sag) projects to at most max_error_px. Terrain that is not in view is kept where
// its shadow can reach what is, fine enough that its height error stays within the same bound at the nearest place it
// can shade.
#pragma once

#include <optional>
#include <vector>

#include "dem/terrain.h"
#include "engine/view.h"

namespace selenograph::engine {

struct Selection {
  std::vector<dem::BlockId> blocks;  // sorted; neighbouring levels differ by at most one
  double error_px = 0, error_m = 0;  // bounds over the blocks in view
  double min_spacing_m = 0, max_spacing_m = 0;
  double highest_m = 0;  // no block reaches higher
};

// Past this many blocks (a million quads per 256) a request is refused: std::invalid_argument.
inline constexpr std::size_t kMaxBlocks = 6000;

Selection select_for_view(const dem::Terrain& terrain, const View& view, const Sun* sun, double max_error_px,
                          const StopToken& stop);

// The finest blocks that rays may meet; empty when they are more than max_blocks. Neighbours can differ in level where
// sources do: the mesh joins them all the same.
std::optional<Selection> select_for_rays(const dem::Terrain& terrain, const std::vector<Ray>& rays,
                                         std::size_t max_blocks, const StopToken& stop);

}  // namespace selenograph::engine
