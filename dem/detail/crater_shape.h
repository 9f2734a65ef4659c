// The shape of a simple crater and its degradation; the outline of its rim (CraterOutline).
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
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "dem/base/smoothstep.h"

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
  // its reach, smooth in between.
  static constexpr double kReplaces = 0.85;
  static double replaced_at(double r, double age) { return smoothstep((reach(age) - r) / (reach(age) - kReplaces)); }
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

// The outline of a crater's rim: no circle, but a circle with waves of two to five periods around it.
//
//         .--''-.        A position at r crater radii from the centre has the height that a round crater has at
//       .'       \       r (1 - fade(r) wave(azimuth)): fade is 1 as far as 1 radius and falls to 0 at the reach, so
//      (    o     )      that floor, rim and ejecta are uneven, and the ground beyond the reach stays as it is. The
//       '-._    .'       mean of the wave over all azimuths is 0. Heights stay within the bounds of a round crater.
//           '--'
//
// Waves of n periods fade with age as diffusion has it, as exp(-n^2 kappa t / R^2). The amplitudes are chosen to look
// like images; larger craters are rounder.
class CraterOutline {
 public:
  static constexpr std::size_t kWaves = 4;  // of 2 to 5 periods
  // Bound of the wave's absolute value.
  static constexpr double kMaxWave = 0.23;

  CraterOutline() = default;  // a circle
  // `age`: kappa t / R^2, as of CraterShape.
  CraterOutline(std::uint64_t crater_id, double diameter_m, double age);

  // Coefficients of cos(n azimuth) and of -sin(n azimuth), n = 2 to 5, in crater radii; azimuths from east to north.
  const std::array<float, kWaves>& cosines() const { return cosine_; }
  const std::array<float, kWaves>& sines() const { return sine_; }

  // Returns the wave in the direction of a horizontal unit vector.
  float wave(float east, float north) const {
    // Sum the real parts of c_n z^n by Horner's scheme, z = east + i north.
    float re = 0, im = 0;
    for (std::size_t n = kWaves; n-- > 0;) {
      re += cosine_[n];
      im += sine_[n];
      const float turned = re * east - im * north;
      im = re * north + im * east;
      re = turned;
    }
    return re * east - im * north;
  }
  // Returns the distance of the rim from the centre in the direction of a horizontal unit vector, in crater radii.
  // `reach`: that of the crater, in radii.
  double rim(double east, double north, double reach) const {
    const double g = static_cast<double>(wave(static_cast<float>(east), static_cast<float>(north)));
    if (g <= 0) return 1 / (1 - g);
    // Solve r (1 - g (reach - r) / (reach - 1)) = 1 for r above 1.
    const double k = g / (reach - 1), b = 1 - k * reach;
    return (std::sqrt(b * b + 4 * k) - b) / (2 * k);
  }
  // Returns the distance at which a round crater is as high as this one is at r radii in that direction.
  double round(double r, double east, double north, double reach) const {
    const double fade = r < 1 ? 1 : (reach - r) / (reach - 1);
    if (fade <= 0) return r;
    return r * (1 - fade * static_cast<double>(wave(static_cast<float>(east), static_cast<float>(north))));
  }

 private:
  std::array<float, kWaves> cosine_{}, sine_{};
};

}  // namespace selenograph::dem
