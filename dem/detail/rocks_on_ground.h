// The rocks of a detail, placed on the terrain.
#pragma once

#include <memory>
#include <vector>

#include "dem/base/cache.h"
#include "dem/base/stop_token.h"
#include "dem/catalogue/catalogue.h"
#include "dem/detail/detailed_terrain.h"
#include "dem/detail/rock_field.h"

namespace selenograph::dem {

struct RockFeature {
  Rock rock;
  const Rock& member() const { return rock; }
  Geographic location;  // position on the ground with detail
  Vec3 position_m;      // the same position, MOON_ME
  Vec3 up;              // the ground's normal, unit
};

// Returns the expected number of rocks in a region by the law, if a new crater of 500 m, the largest of most presets,
// were in its middle.
double max_expected_rocks(const RockField& field, const Footprint& region, double smallest_m);

// A cache of rocks and fresh craters by block; results do not depend on it. Several terrains with detail may share it:
// keys contain their detail_number(). Thread-safe.
class RockMemory {
 public:
  // `bytes`: budget, besides entries in use.
  explicit RockMemory(std::size_t bytes) : fresh_(bytes / 4), rocks_(bytes - bytes / 4) {}
  std::size_t bytes() const { return fresh_.bytes() + rocks_.bytes(); }
  std::uint64_t misses() const { return fresh_.misses() + rocks_.misses(); }

 private:
  friend class RockSurvey;
  struct Key {
    BlockId block;
    int detail;                    // detail_number()
    int octave = 0, min_step = 0;  // smallest diameter: 2^octave (1 + min_step / kSteps) m
    bool operator==(const Key&) const = default;
  };
  struct KeyHash {
    std::size_t operator()(const Key& key) const;
  };
  Cache<Key, std::vector<FreshCrater>, KeyHash> fresh_;
  Cache<Key, std::vector<RockFeature>, KeyHash> rocks_;
};

// Thread-safe: const functions may be called concurrently.
class RockSurvey {
 public:
  // The terrain must have detail and outlive this object. Without `memory`, it has a cache of its own, of kKeptBytes.
  explicit RockSurvey(const Terrain& terrain, std::shared_ptr<RockMemory> memory = nullptr);
  static constexpr std::size_t kKeptBytes = std::size_t{8} << 20;

  const RockField& field() const { return field_; }
  // Appends the rocks of an octave of diameters, at least smallest_m large, with their centre in a box; none where
  // there is no terrain. A rock lies on the level whose posts are half its octave's smallest diameter apart, or on the
  // finest level.
  void add(int octave, const Footprint& box, double smallest_m, std::vector<RockFeature>& out,
           const StopToken& stop) const;
  // Does the same for a block, through the cache. The cached list begins at a slightly smaller diameter, so that a
  // camera that slowly approaches finds it again.
  void add(int octave, const BlockId& block, double smallest_m, std::vector<RockFeature>& out,
           const StopToken& stop) const;
  // Returns all rocks of a region, largest first. Runs on all cores of the caller's arena.
  std::vector<RockFeature> rocks_in(const Footprint& region, double smallest_m, const StopToken& stop) const;

  // Returns the block whose fresh craters apply at a position. Rocks are generated block by block, so that a rock does
  // not depend on the query's extent.
  BlockId block_around(double lat_deg, double lon_deg) const;
  // Returns the fresh craters around a block, cached for neighbouring queries: some kilobytes each.
  using FreshCraters = std::vector<FreshCrater>;
  std::shared_ptr<const FreshCraters> fresh_around(const BlockId& id, const StopToken& stop) const;

 private:
  const DetailedTerrain& terrain_;
  const Detail& detail_;
  const RockField& field_;
  std::shared_ptr<RockMemory> memory_;
};

}  // namespace selenograph::dem
