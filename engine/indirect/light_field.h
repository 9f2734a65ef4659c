// Where indirect light is gathered: square fields of posts, each in the gnomonic plane of one relief (relief.h).
//
// The Moon is divided into bands of latitude, and these into cells about as wide as high, so that poles need no case. A
// field reaches beyond its cell, by as much as a block of the lattice whose middle is in the cell does.
#pragma once

#include <Eigen/Core>
#include <compare>
#include <cstdint>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// Light is gathered at posts at most kCoarser levels coarser than the ground in view, at most kCloser finer where less
// than a pixel is asked for, from terrain of up to kFiner levels more than theirs.
// The largest fields are 32 degrees wide.
inline constexpr int kCoarser = 3, kCloser = 1, kFiner = 1, kCoarsest = 3;

struct LightField {
  std::int32_t level, finest;  // of the posts, and of the terrain
  bool closer;                 // its posts may be kCloser levels finer than the ground in view
  std::int32_t band, cell;
  int stride() const { return 1 << (finest - level); }  // of the relief's posts from one post to the next
  auto operator<=>(const LightField&) const = default;
};

LightField light_field_at(int level, int finest, bool closer, double lat_deg, double lon_deg);

// A place in a field: its tile, the post of that south-west of it, and how far beyond the post.
struct FieldPost {
  int tile, row, column;
  double east, north;
};

// Rows of a tile, a bit each, from the south.
struct TileRows {
  int tile;
  std::uint16_t rows;
  bool has(int row) const { return rows >> row & 1; }
};

// A field's posts, in tiles of 16 x 16: adjacent tiles share a row or a column.
class FieldPlane {
 public:
  static constexpr int kTileQuads = 15, kTileSide = kTileQuads + 1;
  explicit FieldPlane(const LightField& field);

  const Vec3& centre() const { return centre_; }  // unit
  int tiles() const { return tiles_; }            // per side; even
  double spacing_m() const { return spacing_m_; }
  int half_posts() const { return tiles_ / 2 * kTileQuads; }  // from the middle to a side
  double half_m() const { return half_posts() * spacing_m_; }
  // Column and row of any place on or near the ground, from the south-west post.
  Eigen::Vector2d place(const Vec3& position_m) const {
    const Vec3 d = posts_ * position_m;
    return {d.x() / d.z() + middle(), d.y() / d.z() + middle()};
  }
  // A place beside the field is at its border.
  FieldPost post_at(const Vec3& position_m) const;
  // place() for many places: rows of a matrix by which a place's third component divides the others, and what is
  // added to both.
  const double* posts() const { return posts_.data(); }
  double middle() const { return half_posts(); }
  // On the plane, at the datum's radius over its middle; MOON_ME.
  Vec3 at(int column, int row) const;

 private:
  Vec3 centre_;
  Eigen::Matrix3d axes_;                                // the plane's
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> posts_;  // the same, scaled so that quotients are posts
  double spacing_m_;
  int tiles_;
};

}  // namespace selenograph::engine
