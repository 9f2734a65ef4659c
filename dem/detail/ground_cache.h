// Keeps the ground that a terrain with detail has made, in memory and in the cache folder. It lends the task arena to
// those who make ground; the drawing in ground_cache.cpp shows why its threads do not deadlock.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "dem/base/stop_token.h"
#include "dem/detail/detail.h"
#include "dem/grid/block.h"
#include "dem/terrain/pyramid_terrain.h"

namespace selenograph::dem {

// Thread-safe.
class GroundCache {
 public:
  // Kinds of ground: each has keys of its own. An outline is a block without vertices, only its bounds are set.
  enum class Kind { block, mean_correction, layer_posts, outline, relief_factor };
  using Make = std::function<std::shared_ptr<const Block>()>;

  // `plain` must outlive this object.
  GroundCache(const PyramidTerrain& plain, const DetailPreset& preset);

  // Returns the key of an object of a terrain (Terrain::detail_number) in the pyramid's cache. It uses levels above
  // kMaxLevel: keys of the plain terrain's blocks in the same cache cannot collide with it.
  static BlockId key_of(int number, Kind kind, const BlockId& id);

  // Number of this terrain among those that share the pyramid's cache.
  int number() const { return number_; }

  // Returns ground that is in memory; null inside: made, but it has no valid post.
  std::optional<std::shared_ptr<const Block>> find(Kind kind, const BlockId& id) const;
  // Returns ground from memory, or makes it. The first of concurrent callers makes it, the others wait for its flight.
  // Call it inside run_in_arena() only.
  std::shared_ptr<const Block> get(Kind kind, const BlockId& id, const StopToken& stop, const Make& make) const;

  // Waits until the pyramid of a block of posts is built (none: all posts are read from their files), then enters the
  // task arena and returns make().
  std::shared_ptr<const Block> run_in_arena(const std::optional<BlockId>& posts, const StopToken& stop,
                                            const Make& make) const;

  // Reads a block from the cache folder, or makes it and stores it there.
  std::shared_ptr<const Block> read_or_make(const BlockId& id, const Make& make) const;

 private:
  const PyramidTerrain& plain_;
  const int number_;
  const bool storable_;           // the preset has a fingerprint
  const std::uint64_t disk_key_;  // hash of files, preset and the version of the heights
};

}  // namespace selenograph::dem
