#include "engine/radiometry/brdf.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>
#include <variant>

#include "dem/geodesy.h"

namespace selenograph::engine {
namespace {

constexpr double kPi = std::numbers::pi;

double sine_of(double cosine) { return std::sqrt(std::max(0.0, (1 - cosine) * (1 + cosine))); }

// McEwen 1996, degrees.
double lunar_weight(double phase_deg) {
  return std::max(0.0, 1 + phase_deg * (-0.019 + phase_deg * (0.242e-3 - phase_deg * 1.46e-6)));
}

// Paper eq. (11). The halfway vector's cosine follows from the others: (mu0 + mu) / |omega_i + omega_o|.
struct BlinnPhong {
  double factor;  // rho (p + 4) (p + 2) / (8 pi (p + 2^(-p / 2)))
  double p;
  double times_mu0(double mu0, double mu, double cos_phase) const;
};

// McEwen, Icarus 92, 298, 1991, with the weight's phase dependence of his fit to the Moon (1996), or a constant one.
struct LunarLambert {
  double lambert;  // rho / pi
  std::optional<double> weight;
  double times_mu0(double mu0, double mu, double cos_phase) const;
};

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

double BlinnPhong::times_mu0(double mu0, double mu, double cos_phase) const {
  const double sum = std::sqrt(std::max(0.0, 2 * (1 + cos_phase)));  // |omega_i + omega_o|
  const double halfway = sum > 0 ? std::min(1.0, (mu0 + mu) / sum) : 0;
  return mu0 * factor * std::pow(halfway, p);  // eq. (11)
}

double LunarLambert::times_mu0(double mu0, double mu, double cos_phase) const {
  const double l = weight ? *weight : lunar_weight(std::acos(std::clamp(cos_phase, -1.0, 1.0)) * kDegreesPerRadian);
  return lambert * (2 * l * (mu0 / (mu0 + mu)) + (1 - l) * mu0);
}

Hapke::Hapke(const HapkeParameters& parameters) : parameters_(parameters), root_(std::sqrt(1 - parameters.w)) {
  tan_theta_ = std::tan(parameters.theta_bar_deg * kRadiansPerDegree);
  cot_theta_ = tan_theta_ > 0 ? 1 / tan_theta_ : 0;
  chi_ = 1 / std::sqrt(1 + kPi * tan_theta_ * tan_theta_);
}

// (1 + B(g)) p(g)
double Hapke::scattering(double cos_phase) const {
  const HapkeParameters& k = parameters_;
  const double p = phase_function(k, cos_phase);
  if (k.b0 == 0) return p;
  const double tan_half = std::sqrt(std::max(0.0, 1 - cos_phase) / std::max(1e-300, 1 + cos_phase));
  return (1 + k.b0 / (1 + tan_half / k.h)) * p;
}

Hapke::Tilted Hapke::tilted(double mu0, double mu, double cos_phase) const {
  if (tan_theta_ == 0) return {mu0, mu, 1};
  const double sin_i = sine_of(mu0), sin_e = sine_of(mu);
  // Azimuth between Sun and camera; at the zenith of either it doesn't matter.
  const double sines = sin_i * sin_e;
  const double cos_psi = sines > 0 ? std::clamp((cos_phase - mu0 * mu) / sines, -1.0, 1.0) : 1;
  const double psi = std::acos(cos_psi), sin2_half = (1 - cos_psi) / 2;
  const double f = cos_psi > -1 ? std::exp(-2 * std::sqrt((1 - cos_psi) / (1 + cos_psi))) : 0;
  struct Slopes {
    double e1, e2;
  };
  const auto slopes = [&](double cosine, double sine) -> Slopes {
    if (!(sine > 0)) return {0, 0};
    const double x = cot_theta_ * cosine / sine;
    return {std::exp(-2 / kPi * x), std::exp(-x * x / kPi)};
  };
  const Slopes si = slopes(mu0, sin_i), se = slopes(mu, sin_e);
  const auto eta = [&](double cosine, double sine, const Slopes& s) {
    return chi_ * (cosine + sine * tan_theta_ * s.e2 / (2 - s.e1));
  };
  const double eta_i = eta(mu0, sin_i, si), eta_e = eta(mu, sin_e, se);
  const bool steeper = mu0 >= mu;  // the Sun stands higher than the camera
  const Slopes &low = steeper ? se : si, &high = steeper ? si : se;
  const double share = 2 - low.e1 - psi / kPi * high.e1;
  // Of the one that stands higher, and of the other.
  const double above = (cos_psi * low.e2 + sin2_half * high.e2) / share, below = (low.e2 - sin2_half * high.e2) / share;
  const double mu0e = chi_ * (mu0 + sin_i * tan_theta_ * (steeper ? above : below)),
               mue = chi_ * (mu + sin_e * tan_theta_ * (steeper ? below : above));
  const double visible = steeper ? mu0 / eta_i : mu / eta_e;
  return {mu0e, mue, mue / eta_e * (mu0 / eta_i) * chi_ / (1 - f + f * chi_ * visible)};
}

double Hapke::times_mu0(double mu0, double mu, double cos_phase) const {
  const Tilted t = tilted(mu0, mu, cos_phase);
  if (!(t.mu0 > 0) || !(t.mu >= 0)) return 0;
  const double terms = scattering(cos_phase) + multiple(t.mu0) * multiple(t.mu) - 1;
  return parameters_.w / (4 * kPi) * (t.mu0 / (t.mu0 + t.mu)) * terms * t.shadowing;
}

using AnyModel = std::variant<BrdfTerms, BlinnPhong, LunarLambert, Hapke>;
AnyModel model_of(const Reflectance& r) {
  const double lommel_seeliger = r.rho / (2 * kPi);  // eq. (10)
  const double lambert = r.rho / kPi;                // eq. (4)
  const double w = r.lommel_seeliger_weight;
  switch (r.model) {
    case ReflectanceModel::lambert:
      return BrdfTerms{0, lambert};
    case ReflectanceModel::lommel_seeliger:
      return BrdfTerms{lommel_seeliger, 0};
    case ReflectanceModel::lommel_seeliger_lambert:
      return BrdfTerms{w * lommel_seeliger, (1 - w) * lambert};  // section 3.1
    case ReflectanceModel::blinn_phong: {
      const double p = r.shininess;
      return BlinnPhong{r.rho * (p + 4) * (p + 2) / (8 * kPi * (p + std::exp2(-p / 2))), p};  // eq. (11)
    }
    case ReflectanceModel::lunar_lambert:
      return LunarLambert{lambert, r.limb_darkening};
    case ReflectanceModel::hapke:
      return Hapke(r.hapke);
  }
  throw std::logic_error("no such reflectance model");
}

}  // namespace

double phase_function(const HapkeParameters& k, double cos_phase) {
  if (k.phase_function == PhaseFunction::legendre)
    return 1 + k.b * cos_phase + k.c * (1.5 * cos_phase * cos_phase - 0.5);
  const auto lobe = [&](double x) { return (1 - k.b * k.b) / std::pow(1 + k.b * k.b - 2 * k.b * x, 1.5); };
  return (1 + k.c) / 2 * lobe(cos_phase) + (1 - k.c) / 2 * lobe(-cos_phase);
}

struct Brdf::Model {
  AnyModel is;
};

Brdf::Brdf(const Reflectance& reflectance) {
  AnyModel model = model_of(reflectance);
  if (const auto* terms = std::get_if<BrdfTerms>(&model))
    terms_ = *terms;
  else
    model_ = std::make_shared<const Model>(Model{std::move(model)});
}

double Brdf::times_mu0(double mu0, double mu, double cos_phase) const {
  if (terms_) return terms_->times_mu0(mu0, mu, cos_phase);
  return std::visit([&](const auto& model) { return model.times_mu0(mu0, mu, cos_phase); }, model_->is);
}

double direct_radiance(const Brdf& brdf, double irradiance_w_m2, double mu0, double mu, double cos_phase,
                       double lit_fraction) {
  // A smoothed normal can lean a little away from a camera that sees the facet: grazing emission then.
  return mu0 > 0 ? irradiance_w_m2 * brdf.times_mu0(mu0, std::max(mu, 0.0), cos_phase) * lit_fraction : 0;
}

}  // namespace selenograph::engine
