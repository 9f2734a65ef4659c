// Marches along great circles over nested grids of heights, sixteen places at a time.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "dem/base/uninitialised.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// A march takes so many steps over a distance: steps of a grid's spacing, then longer ones over coarser grids.
inline constexpr float kStepsPerDistance = 24, kPostsPerStep = 2;

// The Sun on the cells of a grid, each between four posts, as arrays like the grid's heights.
struct GroundLight {
  using Values = dem::UninitialisedVector<float>;
  Values nx, ny;  // of the unit normal, in the grids' axes; its z is positive
  Values lit;     // share of the Sun that is seen; 0 where there is no data
  Values albedo;  // of the ground; empty: no map says it, and it is 1
  Values glow;    // radiance in the light from other ground, the Sun's being 1 W m-2; empty: not asked for
};

// Rows are read in whole vectors: arrays end with so many elements that no place needs.
inline constexpr std::size_t kPadding = 4 * kPacket;

// A square grid as marches read it.
struct GridView {
  const float* heights;      // m above the reference; NaN: no data
  const GroundLight* light;  // of the cell north-east of each post; null: none
  float first_m, spacing_m;  // coordinate of row and column 0; spacing
  float posts_per_m;         // its inverse
  float coarser;             // spacing over that of the finest grid: a power of two
  int side;
  float highest_m;  // of this grid and the coarser ones
};

// Sixteen places in a row, equally far apart in x, and the one direction in which they look; the grids' coordinates.
struct alignas(64) MarchLanes {
  float x[kPacket], y;                // m
  alignas(64) float height[kPacket];  // m above the reference
  float ux, uy;                       // unit
};

struct MarchSphere {
  float reference_radius_m;  // radius of height 0
  float datum_radius_m;      // radius of the plane of the coordinates
  float farthest_m;
};

// tangent[i]: of the elevation of the horizon that each lane sees in its direction; -infinity where there is nothing.
// Nothing above `enough[i]` is looked for. Places are `stride` of the finest grid's columns apart, a power of two.
void find_horizons(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride,
                   const float* enough, float* tangent);

// The part of a grid that points in a row see at equal distance: one row of its cells, at columns `column + i * pitch`.
struct RowOfCells {
  int row;
  float column, pitch;  // pitch: 4, 2, 1, 1/2, ...
  float north;          // how far beyond the row's posts, 0 to 1
};

// The view of sixteen points along their direction, from the ground up to the horizon.
struct SeenPiece {
  SeenPiece() {}  // NOLINT(modernize-use-equals-default): nothing is set to zero that is written next
  // Over the piece: integrals over the elevation e of cos^2 e and of sin e cos e; 0 for lanes that see nothing of it.
  alignas(64) float along[kPacket], up[kPacket];
  alignas(64) float tangent[kPacket];  // of the elevation of its middle
  std::size_t grid;
  RowOfCells cells;  // beneath its middle
};

// Appends what is seen, nearest first, to `pieces`; horizon[i]: as of find_horizons().
void find_pieces(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes, int stride,
                 std::vector<SeenPiece>& pieces, float* horizon);

// Light that reaches sixteen places along one azimuth.
struct alignas(64) AzimuthLanes {
  float along[3][kPacket], up[3][kPacket];  // unit: level toward the azimuth, and the vertical; the grids' axes
  float sun[3];                             // unit, the same axes
};

// The ground of a piece: its light and the cosines of incidence, emission and phase toward the places. False: nothing
// is lit. Without `glows`, in the Sun only.
struct alignas(64) PieceLight {
  double mu0[kPacket], mu[kPacket], cos_phase[kPacket], albedo[kPacket];
  float lit[kPacket], glow[kPacket];
};
bool light_piece(const SeenPiece& piece, const GridView& grid, const AzimuthLanes& lanes, bool glows, PieceLight& out);

// Adds what the ground of a piece sends, of mu0 f_r per unit of light: integrals of radiance times the direction.
void add_piece(const SeenPiece& piece, const AzimuthLanes& lanes, const PieceLight& light, const double* reflected,
               bool times_albedo, float (*sum)[kPacket]);

// Adds the integral of the direction over the sky above a horizon, to 1 % of it.
void add_sky(const AzimuthLanes& lanes, const float* horizon, float (*sum)[kPacket]);

}  // namespace selenograph::engine
