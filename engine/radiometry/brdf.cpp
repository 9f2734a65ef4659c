#include "engine/radiometry/brdf.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <numeric>
#include <utility>
#include <variant>

#include "dem/base/vector_targets.h"
#include "engine/radiometry/moon.h"
#include "engine/radiometry/phase_law.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/radiometry/brdf.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// A type per vector target: with a common type, the linker would merge the targets' template instances.
struct Math : LaneMath {};

template <bool kLegendre, bool kOf2002>
void Hapke(const HapkeLaw& law, const double* mu0, const double* mu, const double* cos_phase, const double* albedo,
           double* out) {
  double w[kPacket];
  for (int i = 0; i < kPacket; ++i) w[i] = albedo ? albedo[i] : law.albedo();
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) out[i] = law.times_mu0<Math, kLegendre, kOf2002>(mu0[i], mu[i], cos_phase[i], w[i]);
}

void HapkeLanes(const HapkeLaw& law, const double* mu0, const double* mu, const double* cos_phase, const double* albedo,
                double* out) {
  law.with_kind(
      [&]<bool kLegendre, bool kOf2002>() { Hapke<kLegendre, kOf2002>(law, mu0, mu, cos_phase, albedo, out); });
}

void OfPhaseLanes(const TermsByPhase& terms, const double* mu0, const double* mu, const double* cos_phase,
                  double* out) {
  // Copy the lanes' cubics: this takes half the time of a vector gather.
  alignas(64) double cubics[kPacket][TermsByPhase::kCoefficients];
  alignas(64) double x[kPacket];
  alignas(64) int intervals[kPacket];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const TermsByPhase::Position position = TermsByPhase::position_of(cos_phase[i]);
    intervals[i] = position.interval;
    x[i] = position.x;
  }
  for (int i = 0; i < kPacket; ++i) std::memcpy(cubics[i], terms.cubics_of(intervals[i]), sizeof cubics[i]);
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) out[i] = TermsByPhase::terms_of(cubics[i], x[i]).times_mu0(mu0[i], mu[i]);
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(HapkeLanes);
HWY_EXPORT(OfPhaseLanes);

namespace {

constexpr double kPi = std::numbers::pi;

// Blinn-Phong, paper eq. (11). The cosine of the halfway vector follows from the others: (mu0 + mu) / |omega_i +
// omega_o|.
struct BlinnPhong {
  double factor;  // rho (p + 4) (p + 2) / (8 pi (p + 2^(-p / 2)))
  double p;
  double times_mu0(double mu0, double mu, double cos_phase) const {
    const double sum = std::sqrt(std::max(0.0, 2 * (1 + cos_phase)));  // |omega_i + omega_o|
    const double halfway = sum > 0 ? std::min(1.0, (mu0 + mu) / sum) : 0;
    return mu0 * factor * std::pow(halfway, p);  // eq. (11)
  }
};

double times_mu0_of(const HapkeLaw& law, double mu0, double mu, double cos_phase) {
  return law.with_kind([&]<bool kLegendre, bool kOf2002>() {
    return law.times_mu0<ScalarMath, kLegendre, kOf2002>(mu0, mu, cos_phase, law.albedo());
  });
}
double times_mu0_of(const TermsByPhase& terms, double mu0, double mu, double cos_phase) {
  return terms.at(cos_phase).times_mu0(mu0, mu);
}
double times_mu0_of(const BlinnPhong& model, double mu0, double mu, double cos_phase) {
  return model.times_mu0(mu0, mu, cos_phase);
}

}  // namespace

struct Brdf::Model {
  std::variant<BlinnPhong, TermsByPhase, HapkeLaw> law;
};

Brdf::Brdf(const Reflectance& r, const Band* band) {
  if (r.model == ReflectanceModel::hapke) {
    model_ = std::make_shared<const Model>(Model{HapkeLaw(r.hapke)});
  } else if (r.model == ReflectanceModel::blinn_phong) {
    const double p = r.shininess;
    model_ = std::make_shared<const Model>(
        Model{BlinnPhong{r.rho * (p + 4) * (p + 2) / (8 * kPi * (p + std::exp2(-p / 2))), p}});  // eq. (11)
  } else if (r.model == ReflectanceModel::moon) {
    model_ = std::make_shared<const Model>(Model{moon_terms(r.ground, band)});
  } else if (varies_by_phase(r)) {
    model_ = std::make_shared<const Model>(Model{TermsByPhase([&](double g) { return terms_at(r, g); })});
  } else {
    terms_ = terms_at(r, 0);
  }
}

double Brdf::times_mu0(double mu0, double mu, double cos_phase) const {
  if (terms_) return terms_->times_mu0(mu0, mu, cos_phase);
  return std::visit([&](const auto& model) { return times_mu0_of(model, mu0, mu, cos_phase); }, model_->law);
}

void Brdf::times_mu0(const double* mu0, const double* mu, const double* cos_phase, const double* albedo,
                     double* out) const {
  if (terms_) {
    for (int i = 0; i < kPacket; ++i) out[i] = terms_->times_mu0(mu0[i], mu[i]);
    return;
  }
  if (const auto* hapke = std::get_if<HapkeLaw>(&model_->law))
    return HWY_DYNAMIC_DISPATCH(HapkeLanes)(*hapke, mu0, mu, cos_phase, albedo, out);
  if (const auto* terms = std::get_if<TermsByPhase>(&model_->law))
    return HWY_DYNAMIC_DISPATCH(OfPhaseLanes)(*terms, mu0, mu, cos_phase, out);
  for (int i = 0; i < kPacket; ++i) out[i] = mu0[i] > 0 ? times_mu0(mu0[i], mu[i], cos_phase[i]) : 0;
}

double diffuse_albedo(const Brdf& brdf, std::optional<double> w) {
  // Each lane is an azimuth.
  constexpr int kSteps = kPacket;
  const auto middle = [](int step) { return (step + 0.5) / kSteps; };
  alignas(64) double incident[kPacket];
  alignas(64) double emitted[kPacket];
  alignas(64) double cos_phase[kPacket];
  alignas(64) double albedo[kPacket];
  alignas(64) double reflected[kPacket];
  std::fill_n(albedo, kPacket, w.value_or(0));
  double sum = 0;
  for (int i = 0; i < kSteps; ++i)
    for (int o = 0; o < kSteps; ++o) {
      const double mu0 = middle(i), mu = middle(o), across = std::sqrt((1 - mu0 * mu0) * (1 - mu * mu));
      std::fill_n(incident, kPacket, mu0);
      std::fill_n(emitted, kPacket, mu);
      for (int a = 0; a < kSteps; ++a) cos_phase[a] = mu0 * mu + across * std::cos(kPi * middle(a));
      brdf.times_mu0(incident, emitted, cos_phase, w ? albedo : nullptr, reflected);
      sum = std::accumulate(reflected, reflected + kPacket, sum,
                            [&](double partial, double value) { return partial + mu * value; });
    }
  return 4 * kPi * sum / (kSteps * kSteps * kSteps);
}

double direct_radiance(const Brdf& brdf, double irradiance_w_m2, double mu0, double mu, double cos_phase,
                       double lit_fraction) {
  // A smoothed normal can lean slightly away from a camera that sees the facet: treat it as grazing emission.
  return mu0 > 0 ? irradiance_w_m2 * brdf.times_mu0(mu0, std::max(mu, 0.0), cos_phase) * lit_fraction : 0;
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
