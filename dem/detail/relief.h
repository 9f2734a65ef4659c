// Self-affine relief between posts, as a function of place and seed: gradient noise (Perlin, SIGGRAPH 2002) in the
// Moon's body axes, one octave of wavelengths after the other, without poles and seams.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "dem/detail/direction_grid.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

struct ReliefLaw {
  std::uint64_t seed = 0;
  double hurst = 0.9;  // 0.8 to 0.95 over metres to kilometres on old highlands (Rosenburg et al. 2011)
  // RMS difference of height between places this far apart (the Allan deviation; Shepard et al. 2001, JGR 106).
  double deviation_m = 0, baseline_m = 1;
  double longest_m = 1, shortest_m = 2;  // wavelengths; none between: there is none
};

// Const means safe to call concurrently.
class Relief {
 public:
  // Octaves have wavelengths of 2^k m, from the shortest to the longest of the law. Some milliseconds: the octaves'
  // amplitudes are such that their sum deviates as the law says.
  explicit Relief(const ReliefLaw& law);

  int shortest_octave() const { return shortest_; }
  int longest_octave() const { return longest_; }
  // Adds one of these octaves, which is at most most_m(octave) away from 0, to a row of a grid.
  void add_row(int octave, const DirectionGrid& grid, std::size_t row, std::span<double> heights_m) const;
  double most_m(int octave) const;

 private:
  double amplitude_m(int octave) const;
  std::uint64_t seed_;
  int shortest_, longest_;
  std::vector<double> amplitudes_m_;  // of the octaves, from the shortest
};

}  // namespace selenograph::dem
