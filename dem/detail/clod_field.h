// Clods: lumps of soil, millimetres to centimetres wide, as a function of position, seed and law only (size_cells.h).
// With relief alone, ground seen from a few metres looks like cloth.
//
//              .--._          A clod's height is 0.06 to 0.25 of its size. Its outline blends an ellipse, which ends
//      __     /     \         in a vertical step, with a pentagon; its top is tilted. Of overlapping clods of an
//   __/  \___/       \___     octave the highest counts: this bounds the octave's height.
//
// Chang'e-4's close-ups show such lumps. Their shapes and their cover are assumed. Measured RMS heights vary from 1 to
// 18 mm between windows of 125 mm (Guo et al. 2021, Chang'e-4); uniformly strewn clods would not vary so much. Their
// density is therefore multiplied by the exponential of noise with wavelengths of 3.1 and 0.7 m.
#pragma once

#include <cstdint>
#include <span>

#include "dem/detail/direction_grid.h"
#include "dem/detail/region.h"
#include "dem/detail/size_cells.h"

namespace selenograph::dem {

struct ClodLaw {
  std::uint64_t seed = 0;
  double cover = 0;                      // share of ground under the clods of a whole octave, before overlaps
  double largest_m = 1, smallest_m = 1;  // lengths of the longer axis; equal: no clods
};

// Thread-safe: const functions may be called concurrently.
class ClodField {
 public:
  explicit ClodField(const ClodLaw& law, const Region& region_of_centres = {});

  // Octaves [2^k, 2^(k+1)) m of sizes; smallest above largest: no clods.
  int smallest_octave() const { return cells_.smallest_octave(); }
  int largest_octave() const { return cells_.largest_octave(); }
  // Mean height of an octave of clods, and a bound on their height, m.
  double mean_m(int octave) const;
  double max_height_m(int octave) const;
  // Adds one octave of clods to the heights at a grid's positions, row by row, and subtracts `shares` (empty: 1
  // everywhere) times its mean height. Sets `on_clod`, unless it is empty, to 1 where a clod of this octave shows.
  void add(const DirectionGrid& grid, int octave, std::span<const double> shares, std::span<double> heights_m,
           std::span<float> on_clod, const StopToken& stop) const;

 private:
  // Density of clods at a direction relative to its mean, at most kMaxDensity.
  double patchiness(const Vec3& direction) const;

  ClodLaw law_;
  Region region_;
  double mean_m_per_m_ = 0;  // mean height of clods between two sizes, over the difference of the sizes
  SizeCells cells_;
};

}  // namespace selenograph::dem
