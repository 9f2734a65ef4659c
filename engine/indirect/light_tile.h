// Indirect light at the posts of a field (light_field.h), tile by tile.
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
#include "engine/frame/request.h"
#include "engine/indirect/light_field.h"
#include "engine/indirect/light_lanes.h"
#include "engine/indirect/slope_light.h"
#include "engine/support/content_key.h"

namespace selenograph::engine {

struct PostGround {
  Eigen::Vector3f normal;  // unit, MOON_ME; zero: no data
  float height_m;          // NaN: no data
};

// FieldPlane::kTileSide squared posts, row-major from the south-west.
struct LightTile {
  static constexpr std::size_t kPosts = std::size_t{FieldPlane::kTileSide} * FieldPlane::kTileSide;
  static constexpr std::size_t first_of(int row) { return static_cast<std::size_t>(row) * FieldPlane::kTileSide; }
  std::array<LightPost, kPosts> posts;
  std::array<PostGround, kPosts> ground;
  // Per row, the largest share of a post's hemisphere that is ground; 0 without light from terrain.
  std::array<float, FieldPlane::kTileSide> most_ground_view{};
};

// `direct_w_m2`: the Sun's, at normal incidence.
LightSources light_sources(const FrameRequest& request, double direct_w_m2);

// Everything but the position that determines the light of a frame's tiles.
struct TileLight {
  const dem::Terrain& terrain;
  const FrameRequest& request;
};

// Tiles on a budget, whose rows are made when they are first asked for: a hovering camera finds them again. So are the
// reliefs that they were gathered from, and the Sun on these. Sun and Earth are taken on a lattice, so that frames of a
// loop find the light again while the Sun moves. Its step follows the elevation over the field's middle: light changes
// by 1 % for each hundredth of it. From 3 to 60 degrees it is at most 0.5 % off, lower the Sun is at most 0.0142
// degrees off. Thread-safe.
class LightTiles {
 public:
  explicit LightTiles(std::size_t bytes);
  ~LightTiles();

  // For each of the tiles, one with those rows; they are the same for the same arguments, whatever is kept. Other rows
  // may change meanwhile. Parallel; throws as Terrain::block does. `plane` is the field's.
  std::vector<std::shared_ptr<const LightTile>> get(const LightField& field, const FieldPlane& plane,
                                                    std::span<const TileRows> tiles, const TileLight& of,
                                                    const StopToken& stop);
  std::size_t bytes() const { return tiles_.bytes() + patches_.bytes(); }
  std::size_t capacity() const { return tiles_.capacity(); }  // for tiles

  // The memory of a tile.
  static std::size_t bytes_of_tile();

 private:
  struct Patch;
  class KeptTile;
  std::shared_ptr<const Relief> relief(const LightField& field, const FieldPlane& plane, const dem::Terrain& terrain,
                                       const StopToken& stop);
  std::shared_ptr<const Patch> patch(const LightField& field, const FieldPlane& plane, const ContentKey& light,
                                     const TileLight& of, const StopToken& stop);

  dem::Cache<ContentKey, KeptTile, ContentKeyHash> tiles_;
  dem::Cache<ContentKey, Patch, ContentKeyHash> patches_;
  std::mutex mutex_;
  std::unordered_map<ContentKey, std::weak_ptr<const Relief>, ContentKeyHash> reliefs_;  // of patches that are kept
};

}  // namespace selenograph::engine
