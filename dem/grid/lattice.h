// The global mesh lattice: a vertex-centred geographic quadtree of blocks of 64 x 64 quads.
//
// Level n has posts at integer multiples of 2^-n degree, so every 2^n px/deg product has its posts on the vertices of
// level n. Blocks of level 4 (16 px/deg, 4 degrees) tile the globe; finer levels split a block in four, coarser ones
// keep its footprint and halve its quads. Towards the poles the longitude step doubles, so that quads keep an aspect of
// 1/4 to 1: by 2^lon_shift, constant along a row of blocks, 0 within 75.5 degrees of the equator, and never past a
// block of 8 degrees.
//
// Positions are exact integers ("ticks" of 2^-28 degree): latitude from the south pole, longitude from -180 eastward.
// A position has the same tick at every level, hence the same sine and cosine, bit for bit.
//
//   level 4, one block          level 5, its four children        posts of both levels: x, of level 5 only: +
//   +-----------------+         +--------+--------+               x  +  x  +  x
//   |                 |         | row 2r+1        |               +  +  +  +  +
//   |  64 x 64 quads  |         +--------+--------+               x  +  x  +  x
//   |  row r, col c   |         | row 2r | 2r     |
//   +-----------------+         +--------+--------+   (columns 2c and 2c + 1 where lon_shift does not change)
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace selenograph::dem {

inline constexpr int kRootLevel = 4;
inline constexpr int kMaxLevel = 25;   // 0.9 mm posts
inline constexpr int kTickLevel = 28;  // an eighth of the finest quad
// Latitudes and longitudes of the lattice, and differences of them.
using Tick = std::int64_t;
inline constexpr Tick kTicksPerDegree = 1 << kTickLevel;
inline constexpr Tick kLatTicks = 180 * kTicksPerDegree;
inline constexpr Tick kLonTicks = 360 * kTicksPerDegree;

// Returns the number of whole steps in a length of a block or less.
inline int steps_in(Tick length, Tick step) { return static_cast<int>(length / step); }

// Returns a / b rounded down; b > 0.
inline std::int64_t floor_div(std::int64_t a, std::int64_t b) { return a / b - (a % b < 0); }

struct BlockId {
  int level = 0, row = 0, col = 0;  // row 0 touches the south pole, column 0 starts at -180
  auto operator<=>(const BlockId&) const = default;
};

std::string to_string(const BlockId& id);  // "L08 r123 c456"

// A block's area: its south-west vertex and the size of a quad, in ticks, and its quads per side.
struct BlockExtent {
  Tick lat0, lon0, lat_step, lon_step;
  int quads;
  Tick lat1() const { return lat0 + quads * lat_step; }
  Tick lon1() const { return lon0 + quads * lon_step; }  // may equal kLonTicks, never exceeds it
};

// Returns the ticks of latitude between posts of a level.
inline Tick lat_step_of(int level) { return Tick{1} << (kTickLevel - level); }

// Return the quads along a side of a level's blocks, the number of rows of blocks, the shift by which a row's longitude
// step exceeds its latitude step (step << shift), its number of blocks, and a block's area.
int quads_per_side(int level);
// Returns the number of triangles of a block: two per quad.
inline std::int64_t triangles_of_block(int level) {
  return std::int64_t{2} * quads_per_side(level) * quads_per_side(level);
}
int rows_of(int level);
int lon_shift(int level, int row);
int columns_of(int level, int row);
BlockExtent extent_of(const BlockId& id);

// Returns the children from south to north and west to east: one if id.level < kRootLevel, else 2 to 4.
std::vector<BlockId> children_of(const BlockId& id);
BlockId ancestor_of(const BlockId& id, int level);          // level <= id.level
BlockId block_at(int level, Tick lat_tick, Tick lon_tick);  // the pole belongs to the last row

Tick wrap_lon(Tick lon_tick);  // into [0, kLonTicks)
inline double lat_deg_of(Tick lat_tick) { return -90.0 + static_cast<double>(lat_tick) / kTicksPerDegree; }
inline double lon_deg_of(Tick lon_tick) { return -180.0 + static_cast<double>(lon_tick) / kTicksPerDegree; }

// Returns the post spacing along a meridian on the sphere, m.
double post_spacing_m(int level);

// Returns the largest distance between a level's chords and the sphere above them, m: half a quad's diagonal, squared,
// over 2 R.
double chord_sag_m(int level);

// Level whose chords stay within 2 mm of the sphere. The finest surface of coarser posts is subdivided to it.
inline constexpr int kSmoothLevel = 8;

// Returns the largest distance, along the meridian, between parallels through a block and the chords of its quads, m:
// the surface shows a parallel's heights along its chord. 0 at the equator, large beside a pole.
double parallel_shift_m(const BlockId& id);

struct BlockIdHash {
  std::size_t operator()(const BlockId& id) const {
    return std::hash<std::uint64_t>()((static_cast<std::uint64_t>(id.level) << 58) ^
                                      (static_cast<std::uint64_t>(id.row) << 29) ^ static_cast<std::uint64_t>(id.col));
  }
};

}  // namespace selenograph::dem
