// Bidirectional reflectance distribution functions behind one interface: SENSOR++ (Paproth et al.), sections 2.2, 3.1
// and 3.2, and what other tools offer for the Moon.
#pragma once

#include <variant>

#include "engine/frame/surface.h"
#include "engine/radiometry/photometry.h"

namespace selenograph::engine {

// Paper eq. (11). The halfway vector's cosine follows from the others: (mu0 + mu) / |omega_i + omega_o|.
struct BlinnPhong {
  double factor;  // rho (p + 4) (p + 2) / (8 pi (p + 2^(-p / 2)))
  double p;
  double times_mu0(double mu0, double mu, double cos_phase) const;
};

// Above this lunar-Lambert, whose rho is a normal albedo, would reflect more than arrives: 4 rho L towards grazing
// incidence.
inline constexpr double kLunarLambertMaxRho = 0.25;

// McEwen, Icarus 92, 298, 1991, with the weight's phase dependence of his fit to the Moon (1996), or a constant one.
struct LunarLambert {
  double lambert;  // rho / pi
  std::optional<double> weight;
  double times_mu0(double mu0, double mu, double cos_phase) const;
};

// p(g).
double phase_function(const HapkeParameters& parameters, double cos_phase);

// Hapke, Icarus 59, 41, 1984 (roughness: eqs. 47 to 59) on JGR 86, 3039, 1981 with H(x) = (1 + 2x) / (1 + 2x sqrt(1 -
// w)), 4 % from the exact one at most: lunar parameters were fitted with it.
class Hapke {
 public:
  explicit Hapke(const HapkeParameters& parameters);
  double times_mu0(double mu0, double mu, double cos_phase) const;

 private:
  struct Tilted {
    double mu0, mu, shadowing;  // effective cosines; S
  };
  double multiple(double x) const { return (1 + 2 * x) / (1 + 2 * x * root_); }
  double scattering(double cos_phase) const;
  Tilted tilted(double mu0, double mu, double cos_phase) const;

  HapkeParameters parameters_;
  double root_, tan_theta_, cot_theta_, chi_;
};

// mu0 = cos(incidence) > 0, mu = cos(emission) >= 0; cos_phase: of the angle between the directions to Sun and camera.
class Brdf {
 public:
  explicit Brdf(const Reflectance& reflectance);

  // f_r, sr-1.
  double operator()(double mu0, double mu, double cos_phase) const { return times_mu0(mu0, mu, cos_phase) / mu0; }
  // mu0 f_r, which is what radiance is made of: finite towards limb and terminator, where f_r needn't be.
  double times_mu0(double mu0, double mu, double cos_phase) const;

  // Its two constants, if that is all there is to it: whole vectors of pixels are evaluated at once then.
  const BrdfTerms* terms() const { return std::get_if<BrdfTerms>(&model_); }

 private:
  std::variant<BrdfTerms, BlinnPhong, LunarLambert, Hapke> model_;
};

// Paper eq. (2) with tau = 1 and rho / pi replaced by f_r: L = E_sun mu0 f_r s, W m-2 sr-1; 0 where mu0 <= 0.
double direct_radiance(const Brdf& brdf, double irradiance_w_m2, double mu0, double mu, double cos_phase,
                       double lit_fraction);

}  // namespace selenograph::engine
