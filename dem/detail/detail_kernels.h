// Vectorised inner loops of detail: one function each for gradient noise, crater profiles and crater marks. Highway
// compiles them for all instruction sets and chooses at run time; all give the same bits (unit.vector_widths).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "dem/detail/crater_shape.h"

namespace selenograph::dem {

// Positions of a row at which noise is evaluated, in cells of the noise's lattice; z is the same for all.
struct NoiseRow {
  const double *x, *y;
  double z;
  std::size_t n;
};
// Adds `amplitude` times the gradient noise of unit wavelength to `heights`.
void add_noise(const NoiseRow& row, std::uint32_t seed, double amplitude, double* heights);

// A crater over a row of equal latitude. Distances are chords of the unit sphere.
struct CraterOverRow {
  double x, y;              // centre, in the equatorial plane
  double along_axis2;       // squared distance from the row along the Moon's axis
  double reach2;            // squared reach
  double steps;             // profile steps per unit of distance
  double reach_steps;       // profile steps from the centre to the reach
  double per_replaced;      // 1 over the profile steps from CraterShape::kReplaces to the reach
  double per_faded;         // 1 over the profile steps from the mean rim to the reach
  double east_x, east_y;    // unit vector to the east
  double north_x, north_y;  // unit vector to the north
  double north_along_axis;  // its component along the Moon's axis, times the row's distance along it
  const CraterOutline* outline;
  const float *younger, *older;  // profiles to interpolate between
  float share;                   // weight of the older one
  float scale_m;                 // scale of the profiles' heights
};
// A row of a DirectionGrid, and its columns that the crater may reach.
struct RowUnderCrater {
  double cos_lat;
  const double *sin_lon, *cos_lon;
  std::size_t first, past_last;
};
// Replaces the heights that older craters left by the crater's own: heights_m[c] becomes (1 - replaced) * heights_m[c]
// + the crater's height, for columns within its reach; CraterShape::replaced gives the share.
void cast_crater(const CraterOverRow& crater, const RowUnderCrater& row, float* heights_m);
// Sets marks to 1 at positions inside the rim, which lies within the reach.
void mark_crater(const CraterOverRow& crater, const RowUnderCrater& row, float* marks);

}  // namespace selenograph::dem
