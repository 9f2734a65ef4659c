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

// Largest rho of lunar-Lambert, whose rho is a normal albedo. A larger one would reflect more light than arrives: 4 rho
// L toward grazing incidence.
inline constexpr double kLunarLambertMaxRho = 0.25;

// Reflectance of a surface. Arguments: mu0 = cos(incidence) > 0, mu = cos(emission) >= 0; cos_phase, cosine of the
// angle between the directions to Sun and camera.
class Brdf {
 public:
  // `band`: band of the light, which decides the reflectance of the model `moon`; null: all wavelengths. Needed during
  // the call only.
  explicit Brdf(const Reflectance& reflectance, const Band* band = nullptr);

  // Returns f_r, sr-1.
  double operator()(double mu0, double mu, double cos_phase) const { return times_mu0(mu0, mu, cos_phase) / mu0; }
  // Returns mu0 f_r, the factor in radiance. It stays finite toward limb and terminator, where f_r may not.
  double times_mu0(double mu0, double mu, double cos_phase) const;

  // Returns the constants of a model that has only these two; null for other models.
  const BrdfTerms* terms() const { return terms_ ? &*terms_ : nullptr; }

  // Computes mu0 f_r of a packet, with a relative error of 1e-6; undefined in lanes without mu0 > 0. `albedo`: null, or
  // one per lane, 0 to 1, that replaces Hapke's w.
  void times_mu0(const double* mu0, const double* mu, const double* cos_phase, const double* albedo, double* out) const;

 private:
  struct Model;  // a model with other parameters
  std::optional<BrdfTerms> terms_;
  std::shared_ptr<const Model> model_;
};

// Returns the reflected share of diffuse light that arrives from the full hemisphere. `w` replaces Hapke's.
double diffuse_albedo(const Brdf& brdf, std::optional<double> w = std::nullopt);

// Returns paper eq. (2) with tau = 1 and f_r for rho / pi: L = E_sun mu0 f_r s, W m-2 sr-1; 0 for mu0 <= 0.
double direct_radiance(const Brdf& brdf, double irradiance_w_m2, double mu0, double mu, double cos_phase,
                       double lit_fraction);

}  // namespace selenograph::engine
