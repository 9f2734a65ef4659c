// Phase dependence of Lommel-Seeliger and lunar-Lambert, which have none of their own: McEwen's A(g). Written once,
// branch-free, for single lanes and for vectors.
#pragma once

#include "engine/frame/surface.h"
#include "engine/radiometry/photometry.h"
#include "engine/support/lane_math.h"

namespace selenograph::engine {

// McEwen's L(g) of the Moon (LPSC XXVII, 841, 1996), fitted from 19.5 to 101 degrees; 0 where the cubic is negative.
SELENOGRAPH_LANE double mcewen_limb_darkening(double phase_deg) {
  const double cubic = 1 + phase_deg * (-0.019 + phase_deg * (0.242e-3 - phase_deg * 1.46e-6));
  return cubic > 0 ? cubic : 0.0;
}

// Integrated light of a uniform sphere at phase angle g, relative to a white Lambert disc of its size that faces Sun
// and camera: for Lommel-Seeliger's 2 mu0 / (mu0 + mu) it is 1 at g = 0, for Lambert's mu0 it is 2/3. Closed forms,
// e.g. Hapke, Theory of Reflectance and Emittance Spectroscopy (2012), 11.
double lommel_seeliger_sphere(double phase_deg);
double lambert_sphere(double phase_deg);

// The Moon's integrated light at phase angle g relative to g = 0. Allen (Astrophysical Quantities, 1973; also JPL
// Horizons): 0.026 g + 4e-9 g^4 magnitudes, observed to 150 degrees and constant beyond. ROLO: Kieffer & Stone (AJ 129,
// 2887, 2005), eq. (10), band at 553.8 nm, without libration and solar longitude, from 1.55 to 97 degrees; extrapolated
// to 0, and beyond 97 in proportion to Allen's. 1 for `none`.
double moon_light(PhaseLaw law, double phase_deg);

// Calls visit.operator()<kLaw>(): loops over lanes need the law as a constant.
template <class Visit>
auto with_law(PhaseLaw law, const Visit& visit) {
  switch (law) {
    case PhaseLaw::allen:
      return visit.template operator()<PhaseLaw::allen>();
    case PhaseLaw::rolo:
      return visit.template operator()<PhaseLaw::rolo>();
    case PhaseLaw::none:
      break;
  }
  return visit.template operator()<PhaseLaw::none>();
}

// The two constants of lambert, lommel_seeliger, lommel_seeliger_lambert and lunar_lambert as functions of the phase
// angle, times f(g) = moon_light(g) over the sphere's own light with these constants, both relative to g = 0. With
// McEwen's L(g) this is his A(g).
class TermsByPhase {
 public:
  explicit TermsByPhase(const Reflectance& reflectance);

  // Whether they depend on the phase angle.
  bool vary() const { return law_ != PhaseLaw::none || weighed_ > 0; }
  PhaseLaw law() const { return law_; }

  template <class Math, PhaseLaw kLaw>
  SELENOGRAPH_LANE BrdfTerms at(double cos_phase) const;

  template <class Math, PhaseLaw kLaw>
  SELENOGRAPH_LANE static double light(double phase_deg);
  template <class Math>
  SELENOGRAPH_LANE static double seeliger_sphere(double phase_deg);
  template <class Math>
  SELENOGRAPH_LANE static double diffuse_sphere(double phase_deg);

 private:
  static constexpr double kAllenLast_deg = 150, kRoloLast_deg = 97, kRadian = 0.017453292519943295;
  template <class Math>
  SELENOGRAPH_LANE static double rolo_reflectance(double phase_deg);

  PhaseLaw law_;
  double weighed_;             // 1: McEwen's L; 0: constant. (A bool would prevent vectorisation.)
  double seeliger_, lambert_;  // if weighed: for L = 1 and L = 0
  double full_ = 1;            // the sphere's light at 0
};

template <class Math>
double TermsByPhase::rolo_reflectance(double g) {
  // Table 4, 553.8 nm; a in radians.
  const double r = g * kRadian, linear = -2.12504 + r * (-1.65970 + r * (0.38409 - r * 0.20655));
  return Math::exp(linear + 0.37206 * Math::exp(g * (-1 / 4.06054)) - 0.10745 * Math::exp(g * (-1 / 12.8802)) +
                   0.00347 * Math::cos((g + 30.5858) * (1 / 16.7498)));
}

template <class Math, PhaseLaw kLaw>
double TermsByPhase::light(double phase_deg) {
  if constexpr (kLaw == PhaseLaw::none) return 1;
  const auto allen = [](double g) {
    const double within = g < kAllenLast_deg ? g : kAllenLast_deg, square = within * within;
    return Math::exp(-0.9210340371976184 * (0.026 * within + 4e-9 * square * square));  // 0.4 ln 10
  };
  if constexpr (kLaw == PhaseLaw::allen) return allen(phase_deg);
  const double within = phase_deg < kRoloLast_deg ? phase_deg : kRoloLast_deg;
  // A call would keep the loop around this from becoming vectors.
  constexpr double kRoloFull = 0.1554694377026012;
  return rolo_reflectance<Math>(within) / kRoloFull * (allen(phase_deg) / allen(within));
}

template <class Math>
double TermsByPhase::seeliger_sphere(double phase_deg) {
  const double half = phase_deg * (kRadian / 2), cosine = Math::cos(half), sine = Math::cos(half - 1.5707963267948966);
  const double quarter = sine / (1 + cosine), safe = quarter > 1e-9 ? quarter : 1e-9;  // tan g / 4
  return 1 + sine * sine / (cosine > 1e-9 ? cosine : 1e-9) * Math::log(safe);
}

template <class Math>
double TermsByPhase::diffuse_sphere(double phase_deg) {
  constexpr double kPi = 3.141592653589793;
  const double g = phase_deg * kRadian;
  return 2 / (3 * kPi) * (Math::cos(g - kPi / 2) + (kPi - g) * Math::cos(g));
}

template <class Math, PhaseLaw kLaw>
BrdfTerms TermsByPhase::at(double cos_phase) const {
  const double low = cos_phase > -1 ? cos_phase : -1.0;
  const double g = Math::acos(low < 1 ? low : 1.0) * (1 / kRadian);
  const double weight = mcewen_limb_darkening(g);
  const double seeliger = seeliger_ * (1 - weighed_ + weighed_ * weight), lambert = lambert_ * (1 - weighed_ * weight);
  if constexpr (kLaw == PhaseLaw::none) return {seeliger, lambert};
  // Held beyond 150 degrees, where McEwen's L is 0.
  const double within = g < kAllenLast_deg ? g : kAllenLast_deg;
  const double sphere = seeliger / 2 * seeliger_sphere<Math>(within) + lambert * diffuse_sphere<Math>(within);
  const double f = light<Math, kLaw>(within) * full_ / (sphere > 0 ? sphere : 1.0);
  return {seeliger * f, lambert * f};
}

}  // namespace selenograph::engine
