// Phase dependence of Lommel-Seeliger and lunar-Lambert, which have none of their own: McEwen's A(g).
#pragma once

#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "engine/frame/surface.h"
#include "engine/radiometry/photometry.h"
#include "engine/support/lane_math.h"

namespace selenograph::engine {

// Returns McEwen's L(g) of the Moon (LPSC XXVII, 841, 1996), fitted from 19.5 to 101 degrees; 0 where the cubic is
// negative.
double mcewen_limb_darkening(double phase_deg);

// Both return the integrated light of a uniform sphere at phase angle g, relative to a white Lambert disc of its size
// that faces Sun and camera. For Lommel-Seeliger's 2 mu0 / (mu0 + mu) it is 1 at g = 0, for Lambert's mu0 it is 2/3.
// Closed forms, e.g. Hapke, Theory of Reflectance and Emittance Spectroscopy (2012), 11.
double lommel_seeliger_sphere(double phase_deg);
double lambert_sphere(double phase_deg);
// Returns the integrated light for f_r with these constants: the sphere's disc-equivalent reflectance over pi.
double sphere_light(const BrdfTerms& terms, double phase_deg);

// Returns the Moon's integrated light at phase angle g relative to g = 0; 1 for `none`. Allen (Astrophysical
// Quantities, 1973; also JPL Horizons): 0.026 g + 4e-9 g^4 magnitudes, observed to 150 degrees and constant beyond.
// ROLO: Kieffer & Stone (AJ 129, 2887, 2005), eq. (10), band at 553.8 nm, without libration and solar longitude, from
// 1.55 to 97 degrees; extrapolated to 0, and beyond 97 in proportion to Allen's.
double moon_light(PhaseLaw law, double phase_deg);

// First and last phase angles of Allen's and ROLO's observations.
inline constexpr double kAllenLast_deg = 150, kRoloFirst_deg = 1.55, kRoloLast_deg = 97;

// The two constants of f_r as functions of the phase angle: cubics between knots that are evenly spaced in sin(g/2).
// Thus neither an arccosine nor the law itself is computed per pixel. The cubics deviate from the law by at most 1e-6.
class TermsByPhase {
 public:
  static constexpr int kIntervals = 1024;
  static double knot_phase_deg(int knot);  // knots 0 to kIntervals: 0 to 150 degrees; constant beyond

  // `knots`: the law's values at all knots.
  explicit TermsByPhase(const std::vector<BrdfTerms>& knots);
  explicit TermsByPhase(const std::function<BrdfTerms(double phase_deg)>& law);

  SELENOGRAPH_LANE BrdfTerms at(double cos_phase) const {
    const Position position = position_of(cos_phase);
    return terms_of(cubics_of(position.interval), position.x);
  }

  // Steps of at(), for loops over lanes. `c`: both constants' cubics in an interval, kCoefficients numbers; x: position
  // in it, 0 to 1.
  static constexpr int kCoefficients = 8;
  struct Position {
    int interval;
    double x;
  };
  SELENOGRAPH_LANE static Position position_of(double cos_phase) {
    const double half = (1 - cos_phase) / 2, low = half > 0 ? half : 0.0;
    const double sine = std::sqrt(low), knots = (sine < kLastSine ? sine : kLastSine) * (kIntervals / kLastSine);
    const int interval = static_cast<int>(knots < kIntervals - 1 ? knots : kIntervals - 1.0);
    return {interval, knots - interval};
  }
  const double* cubics_of(int interval) const { return cubics_.data() + kCoefficients * interval; }
  SELENOGRAPH_LANE static BrdfTerms terms_of(const double* c, double x) {
    return {c[0] + x * (c[1] + x * (c[2] + x * c[3])), c[4] + x * (c[5] + x * (c[6] + x * c[7]))};
  }

 private:
  static constexpr double kLastSine = 0.9659258262890683;  // sine of 75 degrees, half of the last phase angle
  std::vector<double> cubics_;
};

// Returns true if the constants of lambert, lommel_seeliger, lommel_seeliger_lambert or lunar_lambert depend on the
// phase angle.
bool varies_by_phase(const Reflectance& reflectance);
// Returns these constants at a phase angle, times f(g): moon_light(g) over the sphere's own light with these constants,
// both relative to g = 0. With McEwen's L(g) this is his A(g).
BrdfTerms terms_at(const Reflectance& reflectance, double phase_deg);

}  // namespace selenograph::engine
