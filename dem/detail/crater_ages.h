// Rates at which craters form, and their lifetimes: the production function and the chronology of Neukum, Ivanov &
// Hartmann (2001), Space Sci. Rev. 96, 55, for the Moon.
#pragma once

#include <array>

#include "dem/detail/size_cells.h"

namespace selenograph::dem {

// Returns the cumulative number per m^2 above a diameter on a surface of 1 Ga: the published polynomial between 10 m
// and 1000 km, continued by power laws outside.
double production_per_m2(double diameter_m);

// Returns the number of craters on a surface of the given age over the number on a surface of 1 Ga; the second function
// is its inverse. Unlike the age, this quantity grows uniformly with the number of craters formed.
double production_times(double age_Ma);
double age_Ma_of(double production_times);

// Ages of the craters of a surface whose *visible* craters follow a law. Craters form at the production function's
// rate. Small sizes are in equilibrium: as many have formed as the law counts, and a crater lasts as long as it takes
// to form that number again. Larger sizes have not reached the law: all craters that have formed are still there.
//
//   log N    P                       P  production over the surface's age
//       L__  P                       L  law of visible craters
//          L_X__                     left of X: equilibrium, numbers by the law
//             P L__                  right of X: numbers by production, nothing is worn out yet
//              P    L__   log D
class CraterAges {
 public:
  CraterAges(const SizeFrequency& visible, double smallest_m, double largest_m, double surface_age_Ma);

  struct Life {
    double share;     // share of the law's craters that have formed by now, 0 to 1
    double worn_out;  // production_times() after which a crater is worn out
    double oldest;    // production_times() of the oldest crater present
  };
  Life life(double diameter_m) const;
  // Returns the number per m^2 of craters between two diameters that have formed and are not worn out.
  double number_per_m2(double smallest_m, double largest_m) const;

 private:
  SizeFrequency visible_;
  double first_, step_;               // logarithms of diameters in the table: the first, and their spacing
  double formed_;                     // production_times() of the surface's age
  std::array<double, 64> log_times_;  // logarithm of Life::worn_out, by the logarithm of the diameter
};

}  // namespace selenograph::dem
