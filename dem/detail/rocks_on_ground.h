// The rocks of a detail, placed on the terrain.
#pragma once

#include <memory>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/detail/rock_field.h"
#include "dem/support/cache.h"
#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"

namespace selenograph::dem {

struct RockFeature {
  Rock rock;
  const Rock& member() const { return rock; }
  Geographic place;  // on the ground with detail
  Vec3 position_m;   // the same, MOON_ME
  Vec3 up;           // the ground's normal, unit
};

// Expected number of rocks in a region by the law, if all of it were next to fresh craters.
double most_rocks(const RockField& field, const Footprint& region, double smallest_m);

// Thread-safe: const functions may be called concurrently.
class RockSurvey {
 public:
  // The terrain must have detail and outlive this object.
  explicit RockSurvey(const Terrain& terrain);

  const RockField& field() const { return field_; }
  // Appends the rocks of an octave of diameters, at least smallest_m large, with their centre in a box; none where
  // there is no terrain. A rock lies on the level whose posts are half its octave's smallest diameter apart, or on the
  // finest level.
  void add(int octave, const Footprint& box, double smallest_m, std::vector<RockFeature>& out,
           const StopToken& stop) const;
  // All rocks of a region, on all cores of the caller's arena; largest first.
  std::vector<RockFeature> within(const Footprint& region, double smallest_m, const StopToken& stop) const;

  // Rocks are generated block by block, so that a rock's surroundings do not depend on the query.
  BlockId block_around(double lat_deg, double lon_deg) const;
  // The fresh craters around a block, cached for neighbouring queries: at most kKeptBytes besides those in use, some
  // kilobytes each.
  using FreshCraters = std::vector<FreshCrater>;
  static constexpr std::size_t kKeptBytes = std::size_t{8} << 20;
  std::shared_ptr<const FreshCraters> fresh_around(const BlockId& id, const StopToken& stop) const;

 private:
  const Terrain& terrain_;
  const Detail& detail_;
  const RockField& field_;
  mutable Cache<BlockId, FreshCraters, BlockIdHash> fresh_{kKeptBytes};
};

}  // namespace selenograph::dem
