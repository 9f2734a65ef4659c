// Indirect light at the posts of one block of the lattice.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "dem/grid/lattice.h"
#include "dem/support/cache.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/request.h"
#include "engine/indirect/slope_light.h"
#include "engine/support/content_key.h"

namespace selenograph::engine {

// Light at a post. What comes from terrain is for a Sun of 1 W m-2 at normal incidence.
struct TilePost {
  SectorLight light;
  Eigen::Vector3f normal;  // of the ground, unit, MOON_ME
  float height_m;          // NaN: no data
  float radiosity;         // of the ground itself, in sunlight
  float earth;             // share of the Earth's disc that is seen
};

struct LightTile {
  dem::BlockExtent extent;
  std::vector<TilePost> posts;  // (quads + 1)^2, row-major from the south-west
  std::size_t bytes() const { return sizeof(LightTile) + posts.capacity() * sizeof(TilePost); }
};

// What the light of a frame's tiles depends on besides the block.
struct TileLight {
  const dem::Terrain& terrain;
  const FrameRequest& request;
};

// Light is gathered at posts kFiner levels coarser than the terrain that it comes from, if that has posts so fine.
inline constexpr int kFiner = 3;

// Tiles that were made, on a budget: a hovering camera finds them again. Thread-safe.
class LightTiles {
 public:
  explicit LightTiles(std::size_t bytes) : tiles_(bytes) {}

  // The same for the same arguments, whatever is kept. Parallel; throws as Terrain::block does.
  std::shared_ptr<const LightTile> get(const dem::BlockId& block, const TileLight& of, const StopToken& stop);
  std::size_t bytes() const { return tiles_.bytes(); }
  std::size_t capacity() const { return tiles_.capacity(); }
  // Of a tile of 64 quads, with what a frame makes of it.
  static constexpr std::size_t kBytesOfTile = std::size_t{65} * 65 * (sizeof(TilePost) + 32);

 private:
  dem::Cache<ContentKey, LightTile, ContentKeyHash> tiles_;
};

}  // namespace selenograph::engine
