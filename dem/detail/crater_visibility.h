// The contrast of craters with the ground around them.
//
// A crater's depth is a difference of heights: the mean on a circle of its diameter minus the height at its centre. The
// same difference at arbitrary points of the detail's ground has a root mean square for each diameter:
// the roughness at that size. A crater's visibility is its present depth over this roughness. 5 % of a normal
// distribution are above 1.64: a crater of a larger visibility is hardly mistaken for chance.
#pragma once

#include <array>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/detail.h"

namespace selenograph::dem {

// Mean squares of that difference, by octaves of detail, which are independent of each other. Immutable.
class CraterRoughness {
 public:
  // Measures the detail's own ground at some thousand points per octave, as if its region were everywhere: takes a
  // tenth of a second and more. The same detail gives the same numbers.
  explicit CraterRoughness(const Detail& detail, const StopToken& stop = {});

  // Returns the mean square, m^2, that an octave contributes at a diameter, where amplitudes of relief that follow the
  // posts are multiplied by a factor.
  double mean_square_m2(int octave, double diameter_m, double relief_factor = 1) const;

  // Octaves that may contribute: from the smallest one that the finest level shows up to the largest of the coarsest
  // posts.
  int smallest_octave() const { return smallest_; }
  int largest_octave() const { return smallest_ + static_cast<int>(octaves_.size()) - 1; }

  // Largest visibility: on ground that is otherwise smooth.
  static constexpr double kMaxVisibility = 1000;

 private:
  // Mean squares, m^2, at 1/2, 1, 2 and 4 times the octave's smallest diameter. Larger diameters have the value of the
  // last. Below the first the value falls with the fourth power of the diameter, because ground that is smooth at this
  // scale is a paraboloid.
  static constexpr int kDiameters = 4;
  using Squares = std::array<double, kDiameters>;
  // An octave as a whole, and its relief alone if that follows the posts.
  struct Octave {
    Squares total{}, relief{};
  };
  static Octave measured(const Detail& detail, int octave, const StopToken& stop);
  static double at(const Squares& squares, double diameters);

  int smallest_;
  std::vector<Octave> octaves_;
};

}  // namespace selenograph::dem
