// Finds the rocks of a detail that rays may hit.
#pragma once

#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/rocks_on_ground.h"
#include "dem/terrain/terrain.h"
#include "engine/scene/ray_selection.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {

// Searches terrain with rocks. If few rays pass a block, it searches along each of them. If many rays or bundles pass,
// it finds all rocks in the block or reaching into it, and caches them.
class RocksNearRays {
 public:
  explicit RocksNearRays(const dem::Terrain& terrain) : survey_(terrain) {}

  double largest_m() const { return survey_.field().law().largest_m; }
  // Returns the rocks, largest first; empty if there are more than kMaxRocksOfRays. `blocks`: the blocks that the rays
  // may hit (select_for_rays). Octaves with diameters up to `omitted_m` are omitted.
  std::optional<std::vector<dem::RockFeature>> along(std::span<const RayCone> rays, std::span<const BlockOnRays> blocks,
                                                     double omitted_m, const StopToken& stop);

 private:
  using OctaveBlock = std::pair<int, dem::BlockId>;  // octave and block
  struct Strip {                                     // ground below a section of a ray
    int octave;
    dem::Footprint box;
  };
  struct SearchRegions {
    std::vector<OctaveBlock> octave_blocks;
    std::vector<Strip> strips;
  };
  std::optional<SearchRegions> regions_along(std::span<const RayCone> rays, std::span<const BlockOnRays> blocks,
                                             double omitted_m, const StopToken& stop) const;
  // Finds the rocks of blocks and caches them. Returns false if they are more than kMaxNewRocks.
  bool fill_cache(const std::vector<OctaveBlock>& octave_blocks, const StopToken& stop);

  dem::RockSurvey survey_;
  std::map<OctaveBlock, std::vector<dem::RockFeature>> cache_;
  std::size_t cached_entries_ = 0;
};

}  // namespace selenograph::engine
