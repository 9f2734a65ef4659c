// Indirect light at the posts of a field (light_field.h), made and cached tile by tile.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <unordered_map>
#include <vector>

#include "dem/base/cache.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/light_times.h"
#include "engine/frame/request.h"
#include "engine/indirect/light_field.h"
#include "engine/indirect/light_lanes.h"
#include "engine/indirect/slope_light.h"
#include "engine/support/content_key.h"

namespace selenograph::engine {

struct PostGround {
  Vec3f normal;    // unit normal, MOON_ME; zero without data
  float height_m;  // m above the datum; NaN without data
};

// Light at FieldPlane::kTileSide squared posts, row by row from the south-west.
struct LightTile {
  static constexpr std::size_t kPosts = std::size_t{FieldPlane::kTileSide} * FieldPlane::kTileSide;
  static constexpr std::size_t first_of(int row) { return static_cast<std::size_t>(row) * FieldPlane::kTileSide; }
  std::array<LightPost, kPosts> posts;
  std::array<PostGround, kPosts> ground;
  // Per row of posts, the largest share of a post's hemisphere that ground fills; 0 without light from terrain.
  std::array<float, FieldPlane::kTileSide> max_ground_view{};
};

// Returns the sources of a request's indirect light. `direct_w_m2`: the Sun's irradiance at normal incidence.
LightSources light_sources(const FrameRequest& request, double direct_w_m2);

// Everything except the position that the light of a frame's tiles depends on.
struct TileInputs {
  const dem::Terrain& terrain;
  const FrameRequest& request;
  std::size_t tiles;  // number of tiles of all fields of the frame
};

// Cache of tiles with a memory budget. Rows of tiles, reliefs and the sunlight on them are made on first request and
// kept, so a hovering camera finds them again.
//
// Directions of Sun and Earth are rounded to a lattice, so that the frames of a loop share the light while the Sun
// moves. The lattice step grows with the elevation over the field's middle: light changes by 1 % for each hundredth of
// it. From 3 to 60 degrees the light is at most 0.5 % off; lower, the Sun is at most 0.0142 degrees off. Thread-safe.
//
// What rows of posts see of the ground (GroundView) is kept for the next Sun, for as many of a frame's rows as fit: an
// LRU cache of fewer rows than a frame's would have evicted each one before the next frame needs it.
class LightTiles {
 public:
  // Half of the bytes is for views.
  explicit LightTiles(std::size_t bytes);
  ~LightTiles();

  // Returns for each of the tiles one that has the requested rows. Equal arguments give equal rows, whatever is cached;
  // other rows of the tile may be written meanwhile. Parallel; throws as Terrain::block does. `plane` is the field's.
  // `times`: adds its times; may be null.
  std::vector<std::shared_ptr<const LightTile>> get(const LightField& field, const FieldPlane& plane,
                                                    std::span<const TileRows> tiles, const TileInputs& inputs,
                                                    const StopToken& stop, LightTimes* times = nullptr);
  std::size_t bytes() const { return tiles_.bytes() + patches_.bytes() + views_.bytes(); }
  std::size_t capacity() const { return tiles_.capacity(); }  // bytes for tiles

  // Returns the memory of a tile.
  static std::size_t bytes_of_tile();

 private:
  struct Patch;      // relief of a field with the sunlight on it
  class CachedTile;  // tile whose rows are made one by one
  std::shared_ptr<const Relief> relief(const LightField& field, const FieldPlane& plane, const dem::Terrain& terrain,
                                       const StopToken& stop);
  // `light`: key of all that light depends on except the position.
  std::shared_ptr<const Patch> patch(const LightField& field, const FieldPlane& plane, const ContentKey& light,
                                     const TileInputs& inputs, const StopToken& stop);
  dem::Cache<ContentKey, CachedTile, ContentKeyHash> tiles_;
  dem::Cache<ContentKey, Patch, ContentKeyHash> patches_;
  GroundViewStore::Views views_;
  std::mutex mutex_;  // guards reliefs_
  // Reliefs of the cached patches.
  std::unordered_map<ContentKey, std::weak_ptr<const Relief>, ContentKeyHash> reliefs_;
};

}  // namespace selenograph::engine
