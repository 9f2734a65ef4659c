// One block of the mesh: the posts of one level over one quadtree node, with shading normals and sources.
#pragma once

#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "dem/grid/geodesy.h"
#include "dem/grid/lattice.h"

namespace selenograph::dem {

// A file's index in Catalogue::rasters(), which may have more than 64 800 entries. kNoSource: none.
using SourceIndex = std::uint32_t;
inline constexpr SourceIndex kNoSource = 0x3fffffff;

// Origin of a post: a SourceIndex, with kFilledBit if the post was interpolated across no-data, and kBlendedBit if it
// is bent to meet a finer layer.
using SourceMark = std::uint32_t;
inline constexpr SourceMark kFilledBit = 0x80000000, kBlendedBit = 0x40000000, kMarkBits = kFilledBit | kBlendedBit;
inline constexpr SourceIndex source_of(SourceMark mark) { return mark & ~kMarkBits; }
inline constexpr bool is_filled(SourceMark mark) { return (mark & kFilledBit) != 0; }
inline constexpr bool is_blended(SourceMark mark) { return (mark & kBlendedBit) != 0; }

// Bounds of lunar heights (relief: +10 786 m to -9 120 m); a post outside counts as no-data.
inline constexpr float kLowestRelief_m = -12000.F, kHighestRelief_m = 13000.F;
// Radius of a ball that lies below all terrain.
inline constexpr double kCoreRadius_m = kMoonRadius_m + double{kLowestRelief_m};

// Range of heights; low > high if there are none.
struct HeightRange {
  float low, high;
};

// Content that a vertex shows: the DEM, including interpolation between its posts, or detail finer than the posts.
// These are values of the product `detail`, which also has rocks.
enum class Ground : std::uint8_t { dem = 0, crater = 1, relief = 2, rock = 3, clod = 4 };

// Data of a vertex that do not follow from the lattice: sixteen bytes, as rendering fetches them.
struct alignas(16) Vertex {
  float height_m;  // above the datum; NaN: no data
  Vec3f normal;    // unit, MOON_ME, for shading: see shading_normals.h
};
static_assert(sizeof(Vertex) == 16);

// A factor of 1 as Block::brightness has it.
inline constexpr std::uint16_t kBrightnessOfOne = 1 << 14;

// Immutable, shared between frames. Arrays are (quads + 1)^2, row 0 in the south, column 0 in the west.
struct Block {
  BlockId id;
  BlockExtent extent{};
  std::vector<Vertex> vertices;
  std::vector<SourceMark> sources;  // one element for all posts, or one per post
  std::vector<Ground> ground;       // empty: DEM only; otherwise one element for all posts, or one per post
  // Factors of the albedo of made ground, one per post, in units of 1 / kBrightnessOfOne; empty: 1 everywhere.
  std::vector<std::uint16_t> brightness;
  // The same quantities as in NodeInfo.
  double error_m = 0;
  double detail_error_m = 0, left_out_size_m = 0;
  float min_m = 0, max_m = 0;  // range of these heights and of the finest surface
  // Separable sines and cosines of rows and columns, for fast conversion to Cartesian coordinates.
  std::vector<double> sin_lat, cos_lat, sin_lon, cos_lon;

  int side() const { return extent.quads + 1; }
  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(side()) + static_cast<std::size_t>(c);
  }
  SourceMark source(int r, int c) const { return sources.size() == 1 ? sources[0] : sources[index(r, c)]; }
  Ground shown(int r, int c) const {
    if (ground.empty()) return Ground::dem;
    return ground.size() == 1 ? ground[0] : ground[index(r, c)];
  }
  // Reduces `sources` and `ground` to one element where all are the same, and `brightness` to none where all are 1.
  void pack() {
    if (std::all_of(brightness.begin(), brightness.end(), [](std::uint16_t b) { return b == kBrightnessOfOne; }))
      brightness = {};
    const auto packed = [](auto& of_vertices) {
      if (std::any_of(of_vertices.begin(), of_vertices.end(), [&](auto v) { return v != of_vertices[0]; })) return;
      if (!of_vertices.empty()) of_vertices.erase(of_vertices.begin() + 1, of_vertices.end());
      of_vertices.shrink_to_fit();
    };
    packed(sources);
    packed(ground);
  }
  Vec3 position(int r, int c, double height_m) const {
    const auto row = static_cast<std::size_t>(r), col = static_cast<std::size_t>(c);
    const double radius = kMoonRadius_m + height_m;
    return {radius * cos_lat[row] * cos_lon[col], radius * cos_lat[row] * sin_lon[col], radius * sin_lat[row]};
  }
  std::size_t bytes() const {
    // Count vertices as allocated: the heap rounds arrays of their size up by a fifth.
    return sizeof(Block) + ::malloc_usable_size(const_cast<Vertex*>(vertices.data())) +
           sources.size() * sizeof(SourceMark) + ground.size() + 2 * brightness.size() +
           8 * 2 * (sin_lat.size() + sin_lon.size());
  }
};

// Returns the post of a block at a position in ticks, if the block's lattice has a valid one there.
inline std::optional<float> post_at(const Block& block, std::int64_t lat, std::int64_t lon) {
  const BlockExtent& e = block.extent;
  const std::int64_t dy = lat - e.lat0;
  std::int64_t dx = wrap_lon(lon) - e.lon0;
  if (dx < 0) dx += kLonTicks;  // longitude 180 wraps to -180, but it is the eastern edge of the last block
  if (dy < 0 || dy > std::int64_t{e.quads} * e.lat_step || dx > std::int64_t{e.quads} * e.lon_step || dy % e.lat_step ||
      dx % e.lon_step)
    return std::nullopt;
  const float h =
      block.vertices[block.index(static_cast<int>(dy / e.lat_step), static_cast<int>(dx / e.lon_step))].height_m;
  if (std::isnan(h)) return std::nullopt;
  return h;
}

// Fills the sine and cosine tables from the extent.
void fill_trigonometry(Block& block);
// Returns a block without vertices whose tables are filled.
std::shared_ptr<Block> empty_block(const BlockId& id, const BlockExtent& extent);

}  // namespace selenograph::dem
