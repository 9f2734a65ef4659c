// Bidirectional reflectance distribution functions behind one interface: SENSOR++ (Paproth et al.), sections 2.2, 3.1
// and 3.2, and other lunar models.
#pragma once

#include <memory>
#include <optional>

#include "engine/frame/band.h"
#include "engine/frame/surface.h"
#include "engine/radiometry/hapke.h"
#include "engine/radiometry/photometry.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// Largest rho of lunar-Lambert, where it is a normal albedo: above this it would reflect more than arrives, 4 rho L
// towards grazing incidence.
inline constexpr double kLunarLambertMaxRho = 0.25;

// mu0 = cos(incidence) > 0, mu = cos(emission) >= 0; cos_phase: cosine of the angle between the directions to Sun and
// camera.
class Brdf {
 public:
  // `band`: that of the light, which decides what `moon` reflects; null: all wavelengths. Needed during the call only.
  explicit Brdf(const Reflectance& reflectance, const Band* band = nullptr);

  // f_r, sr-1.
  double operator()(double mu0, double mu, double cos_phase) const { return times_mu0(mu0, mu, cos_phase) / mu0; }
  // mu0 f_r, the factor in radiance: finite towards limb and terminator, where f_r need not be.
  double times_mu0(double mu0, double mu, double cos_phase) const;

  // The two constants of a model that has no others; null for other models.
  const BrdfTerms* terms() const { return terms_ ? &*terms_ : nullptr; }

  // The same for a whole packet, to a relative error of 1e-6; lanes without mu0 > 0 are undefined. `albedo`: null, or
  // one per lane, 0 to 1, that replaces Hapke's w.
  void times_mu0(const double* mu0, const double* mu, const double* cos_phase, const double* albedo, double* out) const;

 private:
  struct Model;  // any other model
  std::optional<BrdfTerms> terms_;
  std::shared_ptr<const Model> model_;
};

// The share of diffuse light that is reflected: albedo of a place that light reaches from all of its hemisphere. `w`:
// replaces Hapke's.
double diffuse_albedo(const Brdf& brdf, std::optional<double> w = std::nullopt);

// Paper eq. (2) with tau = 1 and rho / pi replaced by f_r: L = E_sun mu0 f_r s, W m-2 sr-1; 0 where mu0 <= 0.
double direct_radiance(const Brdf& brdf, double irradiance_w_m2, double mu0, double mu, double cos_phase,
                       double lit_fraction);

}  // namespace selenograph::engine
