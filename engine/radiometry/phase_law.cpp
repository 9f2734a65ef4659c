#include "engine/radiometry/phase_law.h"

#include <numbers>

namespace selenograph::engine {

double lommel_seeliger_sphere(double phase_deg) {
  return phase_deg < 180 ? TermsByPhase::seeliger_sphere<ScalarMath>(phase_deg) : 0;
}

double lambert_sphere(double phase_deg) { return TermsByPhase::diffuse_sphere<ScalarMath>(phase_deg); }

double moon_light(PhaseLaw law, double phase_deg) {
  return with_law(law, [&]<PhaseLaw kLaw>() { return TermsByPhase::light<ScalarMath, kLaw>(phase_deg); });
}

TermsByPhase::TermsByPhase(const Reflectance& r)
    : law_(r.phase), weighed_(r.model == ReflectanceModel::lunar_lambert && !r.limb_darkening ? 1 : 0) {
  const double seeliger = r.rho / (2 * std::numbers::pi);  // eq. (10)
  const double lambert = r.rho / std::numbers::pi;         // eq. (4)
  const double w = r.lommel_seeliger_weight, l = r.limb_darkening.value_or(1);
  // Not a switch: models with equations of their own (brdf.cpp) have no such constants, and need not be named here.
  if (r.model == ReflectanceModel::lommel_seeliger)
    seeliger_ = seeliger, lambert_ = 0;
  else if (r.model == ReflectanceModel::lommel_seeliger_lambert)
    seeliger_ = w * seeliger, lambert_ = (1 - w) * lambert;  // section 3.1
  else if (r.model == ReflectanceModel::lunar_lambert)
    seeliger_ = 2 * l * lambert, lambert_ = weighed_ > 0 ? lambert : (1 - l) * lambert;
  else
    seeliger_ = 0, lambert_ = lambert;
  full_ = seeliger_ / 2 + (1 - weighed_) * lambert_ * lambert_sphere(0);  // L(0) = 1
}

}  // namespace selenograph::engine
