// Self-affine relief between posts as a function of position and seed: a sum of octaves of gradient noise (Perlin,
// SIGGRAPH 2002), evaluated on the sphere in the Moon's body axes, hence without seams or poles.
//
//   octave k: wavelength 2^k m, amplitude unit_m * 2^(k H), H the Hurst exponent
//
// Below some decimetres, ground is rougher than an extrapolation of this law. `fine` replaces it there.
//
// Smooth ground is smooth at all scales: on the whole Moon, second differences over 1.9 km correlate with those over
// 3.8 km by 0.83 (logarithms; with slopes by 0.80; GLD100). Where the law has a `min_factor`, amplitudes are multiplied
// by the roughness of the posts over that of the law.
//
//   log amplitude       ____ k+1     Steps of one octave of wavelength scale the amplitude by 2^H: the RMS difference
//               ____ k               of heights at distance d grows as d^H. Octaves between the law's shortest and
//      ____ k-1                      longest wavelength are made.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "dem/detail/direction_grid.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

struct ReliefLaw {
  std::uint64_t seed = 0;
  double hurst = 0.9;  // 0.8 to 0.95 over metres to kilometres on old highlands (Rosenburg et al. 2011)
  // RMS difference of height between points a baseline apart (the Allan deviation; Shepard et al. 2001, JGR 106).
  double deviation_m = 0, baseline_m = 1;
  double longest_m = 1, shortest_m = 2;  // wavelengths; longest below shortest: no relief
  // Factor of the amplitudes on level posts, up to 1. 1: the same amplitudes everywhere.
  double min_factor = 1;
  // Law of the wavelengths below `below_m`; 0: none. Relief between millimetres and metres has a Hurst exponent of 0.5
  // to 0.7 (Helfenstein & Shepard 1999, Apollo's close-up stereo pictures).
  struct Fine {
    double below_m = 0;
    double hurst = 0.52;
    double slope = 0;  // RMS slope along an axis at the wavelength below_m / 2
  } fine{};
};

// Thread-safe: const functions may be called concurrently.
class Relief {
 public:
  // Octaves have wavelengths of 2^k m, from the shortest to the longest of the law. Takes some milliseconds: the
  // amplitudes are fitted so that the sum has the law's deviation; the fit ignores `fine`.
  explicit Relief(const ReliefLaw& law);

  // Returns the RMS second difference of heights over a distance, h(x - d) - 2 h(x) + h(x + d), m. The law with all its
  // wavelengths, without `fine`.
  double second_difference_m(double distance_m) const;
  // Returns whether an octave's amplitude follows the roughness of the posts.
  bool follows_posts(int octave) const {
    return min_factor_ < 1 && shortest_ <= octave && octave <= longest_ && std::ldexp(1.0, octave) >= fine_below_m_;
  }
  bool follows_posts() const { return follows_posts(longest_); }
  double min_factor() const { return min_factor_; }

  int smallest_octave() const { return shortest_; }
  int largest_octave() const { return longest_; }
  // Adds the heights of one octave, at most max_height_m(octave) in absolute value, to a row of a grid.
  void add_row(int octave, const DirectionGrid& grid, std::size_t row, std::span<double> heights_m) const;
  double max_height_m(int octave) const;

 private:
  double amplitude_m(int octave) const;
  std::uint64_t seed_;
  int shortest_, longest_;
  double hurst_, min_factor_, fine_below_m_;
  double second_difference_of_1_m_ = 0;  // RMS second difference over 1 m
  std::vector<double> amplitudes_m_;     // factor of the unit noise, by octave, from the shortest
};

}  // namespace selenograph::dem
