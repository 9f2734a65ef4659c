// Vectorised inner loops of detail: one function each for gradient noise, the heights of a crater and its brightness.
// Highway compiles them for all instruction sets and chooses at run time; all give the same bits (unit.vector_widths).
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "dem/detail/crater_field.h"
#include "dem/detail/direction_grid.h"

namespace selenograph::dem {

// Positions of a row at which noise is evaluated, in cells of the noise's lattice; z is the same for all.
struct NoiseRow {
  const double *x, *y;
  double z;
  std::size_t n;
};
// Adds `amplitude` times the gradient noise of unit wavelength to `heights`.
void add_noise(const NoiseRow& row, std::uint32_t seed, double amplitude, double* heights);

// A crater over a row of equal latitude. Distances are chords of the unit sphere; steps are those of a table by
// distance from the crater's centre.
struct CraterOverRow {
  double x, y;              // centre, in the equatorial plane
  double along_axis;        // distance of the row from the centre along the Moon's axis
  double reach2;            // squared distance up to which positions are evaluated
  double steps;             // steps per unit of distance
  double last_step;         // step at that distance, the last one of the table
  double reach_steps;       // steps from the centre to the crater's reach
  double per_faded;         // 1 over the steps from the mean rim to the reach
  double east_x, east_y;    // unit vector to the east
  double north_x, north_y;  // unit vector to the north
  double north_z;           // its component along the Moon's axis
  const CraterOutline* outline;
};
// A row of a DirectionGrid, and its columns that the crater may reach.
struct RowUnderCrater {
  double cos_lat;
  const double *sin_lon, *cos_lon;
  std::size_t first, past_last;
};
// Calls visit(crater_over_row, row, number of the row's first post) for the rows of a grid that lie within
// `reach_radii` crater radii. `steps`: of the table, per crater radius.
template <typename Visit>
void visit_rows_under(const Crater& crater, double reach_radii, double steps, const DirectionGrid& grid,
                      const Visit& visit);

// Heights of a crater by distance from its centre, in steps up to its reach and two more.
struct CraterProfile {
  const float* heights_m;
  double per_replaced;  // 1 over the steps from CraterShape::kReplaces to the reach
  double rim_steps;     // steps from the centre to the mean rim
};
// Replaces the heights that older craters left by the crater's own: heights_m[c] becomes (1 - replaced) * heights_m[c]
// + the crater's height, for columns within its reach; CraterShape::replaced gives the share. Sets in_rim (null: none)
// to 1 inside the rim.
void cast_crater(const CraterOverRow& crater, const RowUnderCrater& row, const CraterProfile& profile, float* heights_m,
                 float* in_rim);

// Brightness around a crater, in steps up to the last one and two more: what it adds at all azimuths, and what it adds
// times the brightness of its rays less 1.
struct CraterGlow {
  static constexpr std::size_t kAzimuths = 256;  // equally spaced along the square |x| + |y| = 1, from the east
  const float *even, *in_rays;                   // in_rays null: no rays
  const float *near_rays, *far_rays;  // brightness of rays by azimuth, kAzimuths + 1 values: on the rim, and far out
  float rim_steps, far_per_step;      // steps to the rim; 1 over the steps from there to `far_rays`
};
// Adds the brightness to added[c], for columns within the reach.
void brighten_around_crater(const CraterOverRow& crater, const RowUnderCrater& row, const CraterGlow& glow,
                            float* added);

// Returns a crater over the row through its centre.
CraterOverRow crater_over_row(const Crater& crater, double reach_radii, double steps);

template <typename Visit>
void visit_rows_under(const Crater& crater, double reach_radii, double steps, const DirectionGrid& grid,
                      const Visit& visit) {
  CraterOverRow over_row = crater_over_row(crater, reach_radii, steps);
  visit_rows_within(
      grid, crater.centre, std::sqrt(over_row.reach2),
      [&](std::size_t r, std::size_t first_column, std::size_t past_column) {
        over_row.along_axis = grid.sin_lat[r] - crater.centre.z();
        // Skip the row if its distance along the axis alone exceeds the reach.
        if (over_row.along_axis * over_row.along_axis > over_row.reach2) return;
        visit(over_row,
              RowUnderCrater{grid.cos_lat[r], grid.sin_lon.data(), grid.cos_lon.data(), first_column, past_column},
              r * grid.columns());
      });
}

}  // namespace selenograph::dem
