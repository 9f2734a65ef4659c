// Vectorised inner loops of detail.
#pragma once

#include <cstddef>
#include <cstdint>

namespace selenograph::dem {

// Adds `amplitude` times the gradient noise of unit wavelength at places x, y, z to `heights`.
struct NoisePlaces {
  const double *x, *y;
  double z;
  std::size_t n;
};
void add_noise(const NoisePlaces& places, std::uint32_t seed, double amplitude, double* heights);

// A crater over a row of equal latitude. Distances are chords of the unit sphere.
struct CraterOverRow {
  double x, y;                   // centre
  double along_axis2;            // squared distance along the Moon's axis
  double reach2;                 // squared reach
  double steps;                  // steps of the profiles per unit
  double reach_steps;            // to the reach
  double per_replaced;           // 1 over the steps from CraterShape::kReplaces to the reach
  const float *younger, *older;  // profiles to interpolate between
  float share;                   // weight of the older one
  float scale_m;                 // scale of the profiles' heights
};
struct RowUnderCrater {
  double cos_lat;
  const double *sin_lon, *cos_lon;
  std::size_t first, past_last;
};
// Replaces the heights so far, which are those of older craters, by the crater's (CraterShape::replaced).
void cast_crater(const CraterOverRow& crater, const RowUnderCrater& row, float* heights_m);
// Sets marks to 1 at places nearer to the centre than the square root of `within2`.
void mark_crater(const CraterOverRow& crater, const RowUnderCrater& row, double within2, float* marks);

}  // namespace selenograph::dem
