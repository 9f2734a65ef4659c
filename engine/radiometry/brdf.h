// Bidirectional reflectance distribution functions behind one interface: SENSOR++ (Paproth et al.), sections 2.2, 3.1
// and 3.2, and what other tools offer for the Moon.
#pragma once

#include <memory>
#include <optional>

#include "engine/frame/surface.h"
#include "engine/radiometry/hapke.h"
#include "engine/radiometry/photometry.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// Above this lunar-Lambert, whose rho is a normal albedo, would reflect more than arrives: 4 rho L towards grazing
// incidence.
inline constexpr double kLunarLambertMaxRho = 0.25;

// mu0 = cos(incidence) > 0, mu = cos(emission) >= 0; cos_phase: of the angle between the directions to Sun and camera.
class Brdf {
 public:
  explicit Brdf(const Reflectance& reflectance);

  // f_r, sr-1.
  double operator()(double mu0, double mu, double cos_phase) const { return times_mu0(mu0, mu, cos_phase) / mu0; }
  // mu0 f_r, which is what radiance is made of: finite towards limb and terminator, where f_r needn't be.
  double times_mu0(double mu0, double mu, double cos_phase) const;

  // Its two constants, if that is all there is to it.
  const BrdfTerms* terms() const { return terms_ ? &*terms_ : nullptr; }

  // The same for a whole packet, to 1e-6 of itself; what lanes without mu0 > 0 get means nothing. `albedo`: none, or
  // one per lane, 0 to 1, in place of Hapke's w.
  void times_mu0(const double* mu0, const double* mu, const double* cos_phase, const double* albedo, double* out) const;

 private:
  struct Model;  // any other
  std::optional<BrdfTerms> terms_;
  std::shared_ptr<const Model> model_;
};

// Paper eq. (2) with tau = 1 and rho / pi replaced by f_r: L = E_sun mu0 f_r s, W m-2 sr-1; 0 where mu0 <= 0.
double direct_radiance(const Brdf& brdf, double irradiance_w_m2, double mu0, double mu, double cos_phase,
                       double lit_fraction);

}  // namespace selenograph::engine
