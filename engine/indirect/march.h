// Marches along great circles over nested grids of heights, sixteen places at a time.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/support/packet.h"

namespace selenograph::engine {

// A march takes so many steps over a distance: steps of a grid's spacing, then longer ones over coarser grids.
inline constexpr float kStepsPerDistance = 24, kPostsPerStep = 2;

// The Sun on a cell of a grid, between four posts.
struct alignas(16) GroundLight {
  float nx, ny;  // of the unit normal, in the grids' axes; its z is positive
  float lit;     // share of the Sun that is seen; 0 where there is no data
  float albedo;  // of the ground, where a map says it; else 1
};

// A square grid as marches read it.
struct GridView {
  const float* heights;      // m above the reference; NaN: no data
  const GroundLight* light;  // of the cell north-east of each post; null: none
  float first_m, spacing_m;  // coordinate of row and column 0; spacing
  int side;
  float highest_m;  // of this grid and the coarser ones
};

// Sixteen places in the grids' coordinates, and the direction in which each looks.
struct alignas(64) MarchLanes {
  float x[kPacket], y[kPacket];    // m
  float height[kPacket];           // m above the reference
  float ux[kPacket], uy[kPacket];  // unit
};

struct MarchSphere {
  float reference_radius_m;  // radius of height 0
  float datum_radius_m;      // radius of the plane of the coordinates
  float farthest_m;
};

// tangent[i]: of the elevation of the horizon that each lane sees in its direction; -infinity where there is nothing.
// Nothing above `enough[i]` is looked for.
void find_horizons(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes,
                   const float* enough, float* tangent);

// What sixteen places see along their direction, from the ground up to the horizon.
struct SeenPiece {
  // Over the piece: integrals over the elevation e of cos^2 e and of sin e cos e; 0 for lanes that see nothing of it.
  alignas(64) float along[kPacket], up[kPacket];
  alignas(64) float tangent[kPacket];      // of the elevation of its middle
  alignas(64) std::int32_t cell[kPacket];  // of the grid, beneath its middle: its south-west post
  const GroundLight* light;
};

// Appends what is seen, nearest first, to `pieces`.
void find_pieces(std::span<const GridView> grids, const MarchSphere& sphere, const MarchLanes& lanes,
                 std::vector<SeenPiece>& pieces);

// Light that reaches sixteen places along one azimuth.
struct alignas(64) AzimuthLanes {
  float along[3][kPacket], up[3][kPacket];  // unit: level toward the azimuth, and the vertical; the grids' axes
  float sun[3];                             // unit, the same axes
};

// Where the ground of a piece is lit: its light (share of the Sun times albedo) and the cosines of incidence, emission
// and phase toward the places. False: nothing is lit.
struct alignas(64) PieceLight {
  double mu0[kPacket], mu[kPacket], cos_phase[kPacket], albedo[kPacket];
  float lit[kPacket];
};
bool light_piece(const SeenPiece& piece, const AzimuthLanes& lanes, PieceLight& out);

// Adds what the ground of a piece sends, of mu0 f_r per unit of light: integrals of radiance times the direction.
void add_piece(const SeenPiece& piece, const AzimuthLanes& lanes, const PieceLight& light, const double* reflected,
               bool times_albedo, float (*sum)[kPacket]);

}  // namespace selenograph::engine
