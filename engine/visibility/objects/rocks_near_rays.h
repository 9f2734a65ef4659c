// Which rocks of a detail rays may meet.
#pragma once

#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "dem/detail/rocks_on_ground.h"
#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/queries.h"
#include "engine/scene/ray_selection.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {

// Of terrain with rocks. Where few rays pass a block, the rocks along each of them; else all that lie in the block or
// reach into it, which it remembers.
class RocksNearRays {
 public:
  explicit RocksNearRays(const dem::Terrain& terrain) : survey_(terrain) {}

  double largest_m() const { return survey_.field().law().largest_m; }
  // The largest first; nothing where they were more than kMostRocks. `blocks`: what the rays may meet
  // (select_for_rays).
  std::optional<std::vector<dem::RockFeature>> along(std::span<const Ray> rays, std::span<const BlockOnRays> blocks,
                                                     const StopToken& stop);

 private:
  using Piece = std::pair<int, dem::BlockId>;  // of an octave
  struct Strip {                               // beneath a part of a ray
    int octave;
    dem::Footprint box;
  };
  struct Places {
    std::vector<Piece> pieces;
    std::vector<Strip> strips;
  };
  std::optional<Places> places_along(std::span<const Ray> rays, std::span<const BlockOnRays> blocks,
                                     const StopToken& stop) const;
  // From now on they are known; false: their rocks are more than kMostNewRocks.
  bool find(const std::vector<Piece>& pieces, const StopToken& stop);

  dem::RockSurvey survey_;
  std::map<Piece, std::vector<dem::RockFeature>> found_;
  std::size_t remembered_ = 0;
};

}  // namespace selenograph::engine
