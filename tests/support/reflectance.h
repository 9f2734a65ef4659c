// Closed forms of the BRDFs that depend on the cosines of incidence and emission alone.
#pragma once

#include "engine/radiometry/brdf.h"

namespace selenograph::test {

// Returns the two constants of such a BRDF: Lambert, Lommel-Seeliger or their weighted average.
inline engine::BrdfTerms terms_of(const engine::Reflectance& reflectance) { return *engine::Brdf(reflectance).terms(); }

// Returns f_r, sr-1.
inline double brdf(const engine::Reflectance& reflectance, double mu0, double mu) {
  const engine::BrdfTerms terms = terms_of(reflectance);
  return terms.lommel_seeliger / (mu0 + mu) + terms.lambert;
}

inline double direct_radiance(const engine::Reflectance& reflectance, double irradiance_w_m2, double mu0, double mu,
                              double lit_fraction) {
  return engine::direct_radiance(terms_of(reflectance), irradiance_w_m2, mu0, mu, lit_fraction);
}

}  // namespace selenograph::test
