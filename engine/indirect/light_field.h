// Square fields of posts at which indirect light is gathered, each in the gnomonic plane of one relief (engine/relief).
//
// The Moon is divided into bands of latitude, and these into cells about as wide as high, so that poles need no special
// case. A field extends beyond its cell, as far as a block of the lattice does whose middle is in the cell.
#pragma once

#include <compare>
#include <cstdint>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// Posts of light are at most kCoarser levels coarser than the ground in view, and at most kCloser finer where
// spacing_px is below 1. Their relief is up to kFiner levels finer than they are. At level kCoarsest, the lowest that
// posts of light have, fields are 32 degrees wide.
inline constexpr int kCoarser = 3, kCloser = 1, kFiner = 1, kCoarsest = 3;

struct LightField {
  std::int32_t level, finest;  // level of the posts of light; level of the relief
  bool closer;                 // posts may be up to kCloser levels finer than the ground in view
  std::int32_t band, cell;     // band of latitude, from the south; cell of the band, from 180 W
  int stride() const { return 1 << (finest - level); }  // posts of the relief from one post of light to the next
  auto operator<=>(const LightField&) const = default;
};

// Returns the field of these levels whose cell contains a position.
LightField light_field_at(int level, int finest, bool closer, double lat_deg, double lon_deg);

// A position in a field: its tile, the post south-west of it, and its distance from that post in posts, 0 to 1.
struct FieldPost {
  int tile, row, column;
  double east, north;
};

// Some rows of a tile, a bit each, from the south.
struct TileRows {
  int tile;
  std::uint16_t rows;
  bool has(int row) const { return rows >> row & 1; }
};

// Posts of a field in its plane, in tiles of 16 x 16; adjacent tiles share a row or a column of posts:
//
//    o o o ... o o o ... o      tile t has the quads 15 t to 15 t + 14 of each axis,
//    o tile 2  o  tile 3 o      and the posts 15 t to 15 t + 15
//    o o o ... o o o ... o
//    o tile 0  o  tile 1 o
//    o o o ... o o o ... o
class FieldPlane {
 public:
  static constexpr int kTileQuads = 15, kTileSide = kTileQuads + 1;
  explicit FieldPlane(const LightField& field);

  const Vec3& centre() const { return centre_; }  // unit vector, MOON_ME
  int tiles() const { return tiles_; }            // tiles per side; even
  double spacing_m() const { return spacing_m_; }
  int half_posts() const { return tiles_ / 2 * kTileQuads; }   // posts from the middle to a side
  double half_m() const { return half_posts() * spacing_m_; }  // half the side
  // Returns column and row of a position on or near the ground, in posts from the south-west.
  Vec2 posts_from_south_west(const Vec3& position_m) const {
    const Vec3 d = posts_.transpose_times(position_m);
    return {d.x() / d.z() + middle(), d.y() / d.z() + middle()};
  }
  // Returns the post south-west of a position. A position outside the field is clamped to its border.
  FieldPost post_at(const Vec3& position_m) const;
  // The matrix of posts_from_south_west() for vector loops: divide the first two components by the third, and add
  // middle().
  const double* posts() const { return posts_.data(); }
  double middle() const { return half_posts(); }  // row and column of the middle
  // Returns a post's position on the plane, which touches the datum's sphere at the field's middle; MOON_ME, m.
  Vec3 position_m(int column, int row) const;

 private:
  Vec3 centre_;
  Mat3 axes_;   // the plane's axes as rows, in MOON_ME
  Mat3 posts_;  // the same axes as columns, scaled so that quotients are posts
  double spacing_m_;
  int tiles_;
};

}  // namespace selenograph::engine
