// The rocks of a detail, where they lie on the terrain.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "dem/catalogue.h"
#include "dem/detail/rock_field.h"
#include "dem/stop_token.h"
#include "dem/terrain.h"

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

 private:
  const Terrain& terrain_;
  const Detail& detail_;
  const RockField& field_;
  using FreshCraters = std::shared_ptr<const std::vector<FreshCrater>>;
  FreshCraters fresh_around(const BlockId& id) const;
  mutable std::mutex mutex_;
  mutable std::map<BlockId, FreshCraters> fresh_;  // of some blocks, and of what is around them
};

}  // namespace selenograph::dem
