// What detail takes its time for, in vectors of whatever width the machine has.
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
  double x, y;                   // of its centre
  double along_axis2;            // squared part of the distances along the Moon's axis
  double reach2;                 // squared; beyond it there is nothing
  double steps;                  // of the profiles, per unit
  const float *younger, *older;  // its profile lies between these
  float share;                   // of the older one
  float scale_m;                 // of the profiles' unit
};
struct RowUnderCrater {
  double cos_lat;
  const double *sin_lon, *cos_lon;
  std::size_t first, past_last;
};
// The lowest and the highest so far at each place, which are not above and not below 0.
void cast_crater(const CraterOverRow& crater, const RowUnderCrater& row, float* lowest_m, float* highest_m);
// 1 at places nearer to its centre than the root of `within2`.
void mark_crater(const CraterOverRow& crater, const RowUnderCrater& row, double within2, float* marks);

}  // namespace selenograph::dem
