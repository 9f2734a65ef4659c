#include "engine/photometry.h"

#include <algorithm>
#include <numbers>

namespace selenograph::engine {

double brdf(const Reflectance& reflectance, double mu0, double mu) {
  const double lambert = reflectance.rho / std::numbers::pi;                             // eq. (4)
  const double lommel_seeliger = reflectance.rho / (2 * std::numbers::pi) / (mu0 + mu);  // eq. (10)
  switch (reflectance.model) {
    case ReflectanceModel::lambert:
      return lambert;
    case ReflectanceModel::lommel_seeliger:
      return lommel_seeliger;
    case ReflectanceModel::lunar:
      break;
  }
  const double w = reflectance.lommel_seeliger_weight;  // section 3.1: weighted average of (4) and (10)
  return w * lommel_seeliger + (1 - w) * lambert;
}

double direct_radiance(const Reflectance& reflectance, double irradiance_w_m2, double mu0, double mu, double lit_fraction) {
  if (!(mu0 > 0) || lit_fraction <= 0) return 0;
  // A smoothed normal can lean a little away from a camera that sees the facet: grazing emission then.
  return irradiance_w_m2 * mu0 * brdf(reflectance, mu0, std::max(mu, 0.0)) * lit_fraction;  // eq. (2)
}

}  // namespace selenograph::engine
