// Lunar reflectance and radiance: SENSOR++ (Paproth et al.), sections 2.2 and 3.1. Other models are in brdf.h.
#pragma once

namespace selenograph::engine {

// Total solar irradiance at 1 au, W m-2, over all wavelengths: Kopp & Lean 2011 (1360.8 +- 0.5), rounded as in IAU 2015
// resolution B3. Radiance without a band is over the whole solar spectrum.
inline constexpr double kSolarConstant_w_m2 = 1361.0;

// Constants of a BRDF f_r = lommel_seeliger / (mu0 + mu) + lambert, sr-1.
struct BrdfTerms {
  double lommel_seeliger = 0;  // w rho / (2 pi), eq. (10)
  double lambert = 0;          // (1 - w) rho / pi, eq. (4)

  // Returns mu0 f_r, sr-1. mu0 = cos(incidence) > 0, mu = cos(emission) >= 0: n.omega_i and n.omega_o of the paper.
  // Where mu0 and mu both go to 0, Lommel-Seeliger grows without bound, but mu0 f_r, the factor in
  // radiance, stays finite: mu0 / (mu0 + mu) is formed first and is at most 1, however small both are.
  double times_mu0(double mu0, double mu, double = 1) const {
    return lommel_seeliger * (mu0 / (mu0 + mu)) + lambert * mu0;
  }
};

// Returns paper eq. (2) with tau = 1 and f_r for rho / pi: L = E_sun mu0 f_r s, W m-2 sr-1; 0 for mu0 <= 0.
inline double direct_radiance(const BrdfTerms& terms, double irradiance_w_m2, double mu0, double mu,
                              double lit_fraction) {
  // A smoothed normal can lean slightly away from a camera that sees the facet: treat it as grazing emission.
  const double emission = mu > 0 ? mu : 0;
  // Compute this before the condition, so that a loop over lanes is vectorised.
  const double mu0_brdf = terms.times_mu0(mu0, emission);
  return mu0 > 0 ? irradiance_w_m2 * mu0_brdf * lit_fraction : 0;
}

}  // namespace selenograph::engine
