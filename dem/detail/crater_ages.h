// How many craters form, and how long they last: the production function and the chronology of Neukum, Ivanov &
// Hartmann (2001), Space Sci. Rev. 96, 55, for the Moon.
#pragma once

#include <array>

#include "dem/detail/size_cells.h"

namespace selenograph::dem {

// Cumulative number per m^2 above a diameter on a surface of 1 Ga. Between 10 m and 1000 km it is the published
// polynomial; beyond, a power law continues it.
double production_per_m2(double diameter_m);

// The number of craters on a surface of an age over that on one of 1 Ga, and the age (in Ma) that has so many times
// that number.
double production_times(double age_Ma);
double age_Ma_of(double production_times);

// Ages of the craters of a surface whose *visible* craters follow a law. Craters form at the production function's
// rate. A size that has had the time to reach the law is in equilibrium: its craters are worn away after the time in
// which as many form. Others are as many as have formed.
class CraterAges {
 public:
  CraterAges(const SizeFrequency& visible, double smallest_m, double largest_m, double surface_age_Ma);

  struct Life {
    double share;     // of the law's craters that have formed by now
    double worn_out;  // production_times() after which one is worn out
    double oldest;    // production_times() of the oldest that are there
  };
  Life life(double diameter_m) const;
  // Number per m^2 between two diameters that have formed and are not worn out.
  double number_per_m2(double smallest_m, double largest_m) const;

 private:
  SizeFrequency visible_;
  double first_, step_, formed_;
  std::array<double, 64> log_times_;  // by the logarithm of the diameter
};

}  // namespace selenograph::dem
