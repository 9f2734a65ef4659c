// The two inner loops of rasterisation, vectorised with Highway and dispatched at run time: drawing strips into a tile
// of the image, and casting strips onto a band of the shadow map. Both treat a quad of the mesh alike:
//
//     c ------ d     lower half: corners a (south-west), b (south-east), c (north-west)
//     | \      |     upper half: corners d (north-east), b, c; d takes the place of a
//     |   \  up|     Edges have the same three directions in both halves:
//     |lo   \  |       0  eastward     a -> b     c -> d
//     |      \ |       1  northward    a -> c     b -> d
//     a ------ b       2  diagonal     b -> c     b -> c
//
// Both triangles of a shared edge evaluate it from the same end in the same order, so that no sample falls between
// them: each edge function of one triangle is the exact negative of the other's.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "engine/scene/raster_mesh.h"

namespace selenograph::engine {

// Projection to a tile whose rows are exposed one after the other. r: rows below the middle one, at which the tile's
// rows count from `middle`. Of a point p - pivot, each line holds a linear form and its constant:
//
//   X(r) = column[0] + r column[1] + r^2 column[2]                   column x depth
//   Z(r) = depth[0] + r depth[1] + r^2 depth[2]                      depth
//   F(r) = off_row[0] + r off_row[1] + r^2 off_row[2] - r^3 depth[2]   (line - r - middle) x depth
//
// The row that images the point is the root of F. Two steps of Newton's method from 0, kept within `reach`, find it: F
// is nearly straight, because the image moves by a fraction of a pixel per row. Time, and so the pixel, depends on the
// vertex and the tile alone: all triangles of a vertex get the same bits.
struct RowMotion {
  float column[3][4], off_row[3][4], depth[3][4];
  float middle, reach;  // rows
};

// Projection of points relative to the anchor to pixels of one tile: x / z and y / z of row . (p - pivot) + offset.
//
// The pivot is the eye or, for a distant camera, the anchor: relative to an eye 400 000 km away, float would round
// positions by tens of metres. Nearness increases with 1 / depth and is linear in it, and so linear in the image:
// (near0 - near1 row[2] . (p - pivot)) / depth.
struct TileView {
  float pivot[3];   // metres from the anchor
  float row[3][3];  // includes focal lengths and the tile's corner
  float offset[3];
  float near0, near1;
  int width, height;  // pixels
  float min_depth_m;  // near border of the guard band
  // Positions of the samples in pixels, row by row; null: the pixel centres. NaN: the pixel has no sample.
  const float *sample_x, *sample_y;
  float slack[2];           // largest distance of a sample from its pixel centre: columns, rows
  const RowMotion* motion;  // null: the projection is the same in all rows
};
inline constexpr std::size_t kTilePadding = 32;  // entries after the last pixel, for vector loads and prefetching
inline constexpr float kFarthest = -2;           // below the nearness of every triangle

// Nearest triangle of each pixel of a tile, row by row.
struct TileBuffer {
  std::vector<float> nearness;  // kFarthest where no triangle was drawn
  std::vector<std::uint32_t> triangle;
  std::vector<float> sample_x, sample_y;  // storage of TileView::sample_x and sample_y
  void clear(int width, int height);
  std::size_t bytes() const {
    return 4 * (nearness.capacity() + triangle.capacity() + sample_x.capacity() + sample_y.capacity());
  }
};

// The guard band: vertices in front of the eye and less than 16 384 pixels from the tile, where float resolves pixel
// positions to 1/512.
inline constexpr float kGuardBand_px = 16384;
inline bool in_guard_band(float depth, float x, float y, float min_depth_m) {
  return depth >= min_depth_m && std::abs(x) <= kGuardBand_px && std::abs(y) <= kGuardBand_px;
}

// Draws the strip's triangles, two-sided. If the strip `leaves_guard_band`, each triangle is drawn by itself with
// homogeneous edge functions in double. The nearest triangle wins; among equally near ones the choice is the same at
// every vector width.
void draw_strip(const RasterBlock& block, const Strip& strip, const TileView& view, bool leaves_guard_band,
                TileBuffer& out);

// One band of light space: samples in rows of cells, contiguous per row and per cell. Coordinates in metres: u, v
// across the sunlight, d toward the Sun.
struct LightBand {
  float u0, v0;        // corner of the first cell; v0 is the start of the band
  float per_u, per_v;  // cells per metre
  int columns, rows;
  float margin_m;                    // bound of the rounding error of u and v in this band
  std::vector<std::uint32_t> start;  // first sample of each cell, row by row; columns * rows + 1 entries
  std::vector<float> u, v, d;        // 16 entries of padding; d is infinite for a sample in shadow
  // Minimum of d over kCoarse consecutive cells of a row, for a quick rejection; see update_coarse_min.
  static constexpr int kCoarse = 16;
  int coarse_columns = 0;
  std::vector<float> min_d;

  float u_end() const { return u0 + static_cast<float>(columns) / per_u; }
  float v_end() const { return v0 + static_cast<float>(rows) / per_v; }
  float& coarse_min_d(int row, int coarse_column) { return min_d[coarse_index(row, coarse_column)]; }
  float coarse_min_d(int row, int coarse_column) const { return min_d[coarse_index(row, coarse_column)]; }
  std::size_t coarse_index(int row, int coarse_column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(coarse_columns) +
           static_cast<std::size_t>(coarse_column);
  }
  // Returns false only if each sample in the box of cells (columns c0 to c1, rows r0 to r1) is in shadow or at least as
  // high as d_m.
  bool any_below(int c0, int c1, int r0, int r1, float d_m) {
    for (int r = r0; r <= r1; ++r)
      for (int q = c0 / kCoarse; q <= c1 / kCoarse; ++q)
        if (coarse_min_d(r, q) < d_m) return true;
    return false;
  }
};

// Axes of light space, orthonormal: u x v = d, toward the Sun.
struct LightAxes {
  float u[3], v[3], d[3];
};

// Bounding box in light space, metres; it has no lower end toward the Sun.
struct LightBox {
  float u_low, u_high, v_low, v_high, d_high;
};

// Bounds the strip's triangles that face away from the Sun in groups of kOccluderBoxQuads x kOccluderBoxQuads quads.
// Writes a box per group that has such triangles, at most kMaxOccluderBoxes. Returns the number of boxes.
inline constexpr int kOccluderBoxQuads = 8;
inline constexpr std::size_t kMaxOccluderBoxes = 16;  // a strip has at most 16 x 64 quads
std::size_t bound_occluders(const RasterBlock& block, const Strip& strip, const LightAxes& axes, LightBox* boxes);

// Sets low and high to the minimum and maximum of n > 0 values.
void range_of(const float* x, std::size_t n, float& low, float& high);

// Updates band.min_d over a box of cells (columns c0 to c1, rows r0 to r1) from band.d.
void update_coarse_min(LightBand& band, int c0, int c1, int r0, int r1);

// Marks the samples below triangles of the strip that face away from the Sun as shadowed: d becomes infinite.
void cast_strip(const RasterBlock& block, const Strip& strip, const LightAxes& axes, LightBand& band);
void cast_skirt(const Skirt& skirt, const LightAxes& axes, LightBand& band);

}  // namespace selenograph::engine
