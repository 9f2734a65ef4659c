// The rocks of a detail, placed on the terrain.
#pragma once

#include <memory>
#include <vector>

#include "dem/base/cache.h"
#include "dem/base/stop_token.h"
#include "dem/catalogue/catalogue.h"
#include "dem/detail/rock_field.h"
#include "dem/terrain/terrain.h"

namespace selenograph::dem {

struct RockFeature {
  Rock rock;
  const Rock& member() const { return rock; }
  Geographic place;  // on the ground with detail
  Vec3 position_m;   // the same, MOON_ME
  Vec3 up;           // the ground's normal, unit
};

// Expected number of rocks in a region by the law, if a new crater of 500 m, the largest of most presets, were in its
// middle.
double most_rocks(const RockField& field, const Footprint& region, double smallest_m);

// What was found of rocks, kept for whoever asks for the same places next: no answer depends on it. Of any number of
// terrains with detail, which their detail_number() tells apart. Thread-safe.
class RockMemory {
 public:
  // At most so many bytes besides those in use.
  explicit RockMemory(std::size_t bytes) : fresh_(bytes / 4), rocks_(bytes - bytes / 4) {}
  std::size_t bytes() const { return fresh_.bytes() + rocks_.bytes(); }
  std::uint64_t misses() const { return fresh_.misses() + rocks_.misses(); }

 private:
  friend class RockSurvey;
  struct Place {
    BlockId block;
    int detail;
    int octave = 0, least = 0;  // of diameters: 2^octave (1 + least / kSteps) m
    bool operator==(const Place&) const = default;
  };
  struct PlaceHash {
    std::size_t operator()(const Place& place) const;
  };
  Cache<Place, std::vector<FreshCrater>, PlaceHash> fresh_;
  Cache<Place, std::vector<RockFeature>, PlaceHash> rocks_;
};

// Thread-safe: const functions may be called concurrently.
class RockSurvey {
 public:
  // The terrain must have detail and outlive this object. `memory` null: its own, of kKeptBytes.
  explicit RockSurvey(const Terrain& terrain, std::shared_ptr<RockMemory> memory = nullptr);
  static constexpr std::size_t kKeptBytes = std::size_t{8} << 20;

  const RockField& field() const { return field_; }
  // Appends the rocks of an octave of diameters, at least smallest_m large, with their centre in a box; none where
  // there is no terrain. A rock lies on the level whose posts are half its octave's smallest diameter apart, or on the
  // finest level.
  void add(int octave, const Footprint& box, double smallest_m, std::vector<RockFeature>& out,
           const StopToken& stop) const;
  // The same of a block, kept: rocks of a slightly smaller diameter on, so that a camera that comes nearer slowly finds
  // them again.
  void add(int octave, const BlockId& block, double smallest_m, std::vector<RockFeature>& out,
           const StopToken& stop) const;
  // All rocks of a region, on all cores of the caller's arena; largest first.
  std::vector<RockFeature> within(const Footprint& region, double smallest_m, const StopToken& stop) const;

  // Rocks are generated block by block, so that a rock's surroundings do not depend on the query.
  BlockId block_around(double lat_deg, double lon_deg) const;
  // The fresh craters around a block, kept for neighbouring queries: some kilobytes each.
  using FreshCraters = std::vector<FreshCrater>;
  std::shared_ptr<const FreshCraters> fresh_around(const BlockId& id, const StopToken& stop) const;

 private:
  const Terrain& terrain_;
  const Detail& detail_;
  const RockField& field_;
  std::shared_ptr<RockMemory> memory_;
};

}  // namespace selenograph::dem
