// The two inner loops of rasterisation, vectorised with Highway and dispatched at run time.
//
// A shared edge is evaluated from the same end in the same order for both of its triangles, so that no sample falls
// between them.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "engine/scene/raster_mesh.h"

namespace selenograph::engine {

// Projection from places relative to the anchor to pixels of one tile: x / z and y / z of row . (p - pivot) + offset.
//
// The pivot is the eye or, for a distant camera, the anchor: relative to the eye, float would round places by tens of
// metres at 400 000 km. Nearness is an increasing function of 1 / depth and linear in it (and so linear in the image):
// (near0 - near1 row[2] . (p - pivot)) / depth.
struct TileView {
  float pivot[3];   // relative to the anchor, metres
  float row[3][3];  // includes focal lengths and the tile's corner
  float offset[3];
  float near0, near1;
  int width, height;
  float least_depth;  // metres
  // Positions of the samples, row by row, and their largest distance from their pixels; null: they are the pixels. NaN:
  // none.
  const float *sample_x, *sample_y;
  float slack[2];
};
inline constexpr std::size_t kTilePadding = 32;  // padding beyond the last pixel for vectors and prefetching
inline constexpr float kFarthest = -2;           // less than any nearness

// Nearest triangle of each pixel of a tile, row by row.
struct TileBuffer {
  std::vector<float> nearness;  // kFarthest: none
  std::vector<std::uint32_t> triangle;
  std::vector<float> sample_x, sample_y;  // for TileView
  void clear(int width, int height);
  std::size_t bytes() const {
    return 4 * (nearness.capacity() + triangle.capacity() + sample_x.capacity() + sample_y.capacity());
  }
};

// Guard band: in front of the eye and not too far outside the tile. There float resolves a vertex's pixel position to
// 1/512 at 16 384 pixels.
inline constexpr float kGuardBand_px = 16384;
inline bool in_guard_band(float depth, float x, float y, float least_depth) {
  return depth >= least_depth && std::abs(x) <= kGuardBand_px && std::abs(y) <= kGuardBand_px;
}

// Draws the strip's triangles, two-sided. All vertices are inside the guard band unless it `leaves_guard_band`: then
// each triangle is drawn by itself with homogeneous edge functions in double. The nearest triangle wins; among equally
// near ones the choice is the same at every vector width.
void draw_strip(const RasterBlock& block, const Strip& strip, const TileView& view, bool leaves_guard_band,
                TileBuffer& out);

// One band of light space: samples in rows of cells, contiguous per row and per cell. u, v across the Sun's direction,
// d toward the Sun, metres.
struct LightBand {
  float u0, v0;        // corner of the first cell (v0: of the band)
  float per_u, per_v;  // cells per metre
  int columns, rows;
  float margin_m;                    // rounding margin of samples outside the band
  std::vector<std::uint32_t> start;  // columns * rows + 1
  std::vector<float> u, v, d;        // padded by 16; infinite d: in shadow
  // Minimum of d over kCoarse cells of a row, for a quick rejection: see find_least.
  static constexpr int kCoarse = 16;
  int coarse_columns = 0;
  std::vector<float> least;

  float u_end() const { return u0 + static_cast<float>(columns) / per_u; }
  float v_end() const { return v0 + static_cast<float>(rows) / per_v; }
  float& least_of(int row, int coarse_column) { return least[least_at(row, coarse_column)]; }
  float least_of(int row, int coarse_column) const { return least[least_at(row, coarse_column)]; }
  std::size_t least_at(int row, int coarse_column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(coarse_columns) +
           static_cast<std::size_t>(coarse_column);
  }
  // Whether any sample in a box of cells (columns c0 to c1, rows r0 to r1) may be below d_m and is not in shadow yet.
  bool any_below(int c0, int c1, int r0, int r1, float d_m) {
    for (int r = r0; r <= r1; ++r)
      for (int q = c0 / kCoarse; q <= c1 / kCoarse; ++q)
        if (least_of(r, q) < d_m) return true;
    return false;
  }
};

// Light space: u x v = toward the Sun.
struct LightAxes {
  float u[3], v[3], d[3];
};

// A part of light space, m.
struct LightBox {
  float u_low, u_high, v_low, v_high, d_high;
};

// Bounds the strip's triangles that face away from the Sun, in parts of kPartQuads x kPartQuads quads. Writes the boxes
// of parts that have such triangles, kMaxParts at most. Returns their number.
inline constexpr int kPartQuads = 8;
inline constexpr std::size_t kMaxParts = 16;  // of 16 x 64 quads
std::size_t bound_casters(const RasterBlock& block, const Strip& strip, const LightAxes& axes, LightBox* parts);

// Minimum and maximum of n > 0 values.
void range_of(const float* x, std::size_t n, float& low, float& high);

// Sets band.least for a box of cells (columns c0 to c1, rows r0 to r1).
void find_least(LightBand& band, int c0, int c1, int r0, int r1);

// Marks the samples as shadowed that lie under triangles of the strip that face away from the Sun.
void cast_strip(const RasterBlock& block, const Strip& strip, const LightAxes& axes, LightBand& band);
void cast_skirt(const Skirt& skirt, const LightAxes& axes, LightBand& band);

}  // namespace selenograph::engine
