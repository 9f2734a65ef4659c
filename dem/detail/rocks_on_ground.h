// The rocks of a detail, where they lie on the terrain.
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

// How many rocks the law expects in a region, if all of it were next to fresh craters.
double most_rocks(const RockField& field, const Footprint& region, double smallest_m);

// Const means safe to call concurrently.
class RockSurvey {
 public:
  // The terrain has detail and outlives it.
  explicit RockSurvey(const Terrain& terrain);

  const RockField& field() const { return field_; }
  // Of an octave of diameters and at least as large, with their centre in a box: appended. None where there is no
  // terrain. A rock lies on the level whose posts are half its octave's smallest diameter apart, or on the finest that
  // there is.
  void add(int octave, const Footprint& box, double smallest_m, std::vector<RockFeature>& out,
           const StopToken& stop) const;
  // All of a region, in all cores of the caller's arena; the largest first.
  std::vector<RockFeature> within(const Footprint& region, double smallest_m, const StopToken& stop) const;

  // Rocks are drawn block by block, so that a rock's surroundings are the same whoever asks.
  BlockId block_around(double lat_deg, double lon_deg) const;
  // The craters that make a block's rocks denser. Kept for neighbouring pieces, which ask for the same ones: in
  // kKeptBytes at most, besides those that threads are using, some kilobytes each.
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
