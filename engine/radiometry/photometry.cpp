#include "engine/radiometry/photometry.h"

#include <numbers>

namespace selenograph::engine {

BrdfTerms terms_of(const Reflectance& reflectance) {
  const double lommel_seeliger = reflectance.rho / (2 * std::numbers::pi);  // eq. (10)
  const double lambert = reflectance.rho / std::numbers::pi;                // eq. (4)
  const double w = reflectance.lommel_seeliger_weight;
  switch (reflectance.model) {
    case ReflectanceModel::lambert:
      return {0, lambert};
    case ReflectanceModel::lommel_seeliger:
      return {lommel_seeliger, 0};
    default:  // lunar, section 3.1: weighted average of both
      break;
  }
  return {w * lommel_seeliger, (1 - w) * lambert};
}

}  // namespace selenograph::engine
