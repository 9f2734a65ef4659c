// The shape of a simple crater and its degradation.
//
// Fresh shape: Fassett & Thomson (2014), J. Geophys. Res. Planets 119, eq. 4, fitted to craters of 0.8 to 5 km.
// Degradation is diffusion of topography, dh/dt = kappa laplace(h), which depends on time as kappa t / R^2 only: one
// table of solutions serves craters of all sizes. The published profile has a flat rim with two edges. The youngest
// shape has diffused a little (kRounding), which makes the rim round.
//
//   height
//      |            /\,                     rim at r = 1
//    0 +-----------/--`--.______________    pre-impact ground; fresh ejecta end at r = 1.5
//      |         .'
//      | ____.--'                           floor; with age it rises, the rim sinks, and the reach grows
//      +----------+-------+------------- r, in crater radii
//      0          1      1.5
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace selenograph::dem {

class CraterShape {
 public:
  // Solves the equation; takes tens of milliseconds.
  CraterShape();
  // The shape shared by all craters, solved at the first call.
  static const CraterShape& of_all();

  // Returns the height above the pre-impact ground, in diameters, of a crater whose fresh depth from rim to floor is
  // kFreshDepth. `r`: distance from the centre in crater radii; `age`: kappa t / R^2. 0 beyond reach(age).
  double height(double r, double age) const;
  // The same heights as two rows at distances in steps of 1 / kStepsPerRadius, between which the caller interpolates;
  // the rows extend beyond reach(age) by one step.
  struct Profile {
    const float *younger, *older;
    double share;  // weight of the older one
  };
  Profile profile(double age) const;
  static constexpr int kStepsPerRadius = 96;
  // Radius, in crater radii, beyond which less than 2 % of the remaining depth is omitted.
  static double reach(double age) { return 1.5 + 3 * std::sqrt(age + kRounding); }
  // Returns the depth from the highest rim to the floor, relative to that of a fresh crater; age_of is its inverse.
  double depth_left(double age) const;
  double age_of(double depth_left) const;

  // Returns the share of its octave's older ground that a crater replaces: 1 inside kReplaces crater radii, 0 beyond
  // its reach, smooth in between. `t` falls from 1 at kReplaces to 0 at the reach.
  static constexpr double kReplaces = 0.85;
  template <typename Float>
  static Float replaced(Float t) {
    t = std::clamp(t, Float(0), Float(1));
    return t * t * (3 - 2 * t);
  }
  static double replaced_at(double r, double age) { return replaced((reach(age) - r) / (reach(age) - kReplaces)); }
  // Bounds for any number of craters that replace each other: the ground stays between -deepest and highest times the
  // largest scale.
  double deepest() const { return deepest_; }
  double highest() const { return highest_; }

  static constexpr double kFreshDepth = 0.228809953 + 0.036822095;
  // Largest age: a tenth of the depth remains.
  static constexpr double kOldest = 0.4;
  // Age of the shape that counts as fresh.
  static constexpr double kRounding = 0.001;

 private:
  struct Row {
    std::vector<float> heights;  // at multiples of kStep
    double depth = 0;
  };
  struct RowPair {
    const Row &younger, &older;
    double share;  // weight of the older one
  };
  Row row_of(const std::vector<double>& heights, double age, double scale) const;
  RowPair rows_at(double age) const;
  std::vector<Row> rows_;             // for ages in equal steps of their square root
  double deepest_ = 0, highest_ = 0;  // in diameters, divided by the share that the crater replaces there
};

}  // namespace selenograph::dem
