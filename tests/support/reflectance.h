// The BRDFs of two constants as closed forms are written: of a reflectance, by the cosines alone.
#pragma once

#include "engine/radiometry/brdf.h"

namespace selenograph::test {

// Lambert, Lommel-Seeliger and their weighted average only.
inline engine::BrdfTerms terms_of(const engine::Reflectance& reflectance) { return *engine::Brdf(reflectance).terms(); }

// f_r in sr-1.
inline double brdf(const engine::Reflectance& reflectance, double mu0, double mu) {
  const engine::BrdfTerms terms = terms_of(reflectance);
  return terms.lommel_seeliger / (mu0 + mu) + terms.lambert;
}

inline double direct_radiance(const engine::Reflectance& reflectance, double irradiance_w_m2, double mu0, double mu,
                              double lit_fraction) {
  return engine::direct_radiance(terms_of(reflectance), irradiance_w_m2, mu0, mu, lit_fraction);
}

}  // namespace selenograph::test
