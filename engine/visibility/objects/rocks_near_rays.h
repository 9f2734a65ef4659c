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
#include "engine/frame/queries.h"
#include "engine/scene/ray_selection.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {

// For terrain with rocks. If few rays pass a block, it finds the rocks along each of them; otherwise, and where bundles
// of rays pass, all rocks in the block or reaching into it, which it remembers.
class RocksNearRays {
 public:
  explicit RocksNearRays(const dem::Terrain& terrain) : survey_(terrain) {}

  double largest_m() const { return survey_.field().law().largest_m; }
  // Returns the rocks, the largest first; empty when there are more than kMaxRocksOfRays. `blocks`: the blocks that
  // the rays may hit (select_for_rays). Octaves of diameters up to `left_out_m` are left out.
  std::optional<std::vector<dem::RockFeature>> along(std::span<const RayCone> rays, std::span<const BlockOnRays> blocks,
                                                     double left_out_m, const StopToken& stop);

 private:
  using Piece = std::pair<int, dem::BlockId>;  // octave and block
  struct Strip {                               // ground below a part of a ray
    int octave;
    dem::Footprint box;
  };
  struct Places {
    std::vector<Piece> pieces;
    std::vector<Strip> strips;
  };
  std::optional<Places> places_along(std::span<const RayCone> rays, std::span<const BlockOnRays> blocks,
                                     double left_out_m, const StopToken& stop) const;
  // Finds the rocks of pieces and remembers them; false: more than kMaxNewRocks.
  bool find(const std::vector<Piece>& pieces, const StopToken& stop);

  dem::RockSurvey survey_;
  std::map<Piece, std::vector<dem::RockFeature>> found_;
  std::size_t remembered_ = 0;
};

}  // namespace selenograph::engine
