// How far craters stand out from the ground around them.
//
// A crater's depth is a difference of heights: the mean on a circle of its diameter minus the middle. The same
// difference at any place of the detail's ground, craters and relief, has a root mean square for each diameter: the
// roughness at that size. A crater's visibility is its present depth over it. Of a normal distribution 5 % are above
// 1.64: a crater of a larger visibility is hardly taken for chance.
#pragma once

#include <array>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/detail.h"

namespace selenograph::dem {

// Mean squares of that difference, by octaves of detail, which are independent of each other. Immutable.
class CraterRoughness {
 public:
  // Measured on the detail's own ground, some thousand places per octave, as if its region were everywhere: takes
  // a tenth of a second and more. The same detail has the same numbers.
  explicit CraterRoughness(const Detail& detail, const StopToken& stop = {});

  // What the craters and the relief of an octave (Detail) contribute for a diameter, m^2.
  double mean_square_m2(int octave, double diameter_m) const;

  // Octaves that may contribute: those that the finest level shows, up to the largest of the coarsest posts.
  int smallest_octave() const { return smallest_; }
  int largest_octave() const { return smallest_ + static_cast<int>(octaves_.size()) - 1; }

  // Largest visibility: on ground that is otherwise smooth.
  static constexpr double kMostVisible = 1000;

 private:
  // At diameters of half an octave's smallest diameter and 1, 2 and 4 times that: m^2. Beyond them it is that of the
  // last, and falls with the fourth power of the diameter below the first, where all ground is a paraboloid.
  static constexpr int kDiameters = 4;
  using Squares = std::array<double, kDiameters>;
  static Squares measured(const Detail& detail, int octave, const StopToken& stop);

  int smallest_;
  std::vector<Squares> octaves_;
};

}  // namespace selenograph::dem
