// Hapke's bidirectional reflectance: JGR 86, 3039, 1981; roughness: Icarus 59, 41, 1984, eqs. 47 to 59; multiple
// scattering, H and coherent backscatter of 2002: Icarus 157, 523. The same code serves single lanes and vectors of
// lanes, so it has no branches.
#pragma once

#include "engine/frame/surface.h"
#include "engine/support/lane_math.h"

namespace selenograph::engine {

// Returns the phase function p(g).
double phase_function(const HapkeParameters& parameters, double cos_phase);

// P(x) and its mean, Hapke 2002, eqs. 23 to 25. P(x) is the mean of p(g) over a hemisphere of directions around the
// nadir, for a direction with cosine x; `mean` is that of P over directions from below. For `legendre` the series end
// with the first term; for `double_henyey_greenstein` they are truncated at 1e-9 or n = 47.
struct HemisphereMeans {
  static constexpr int kMaxTerms = 24;
  double odd[kMaxTerms];  // A_n b_n for n = 1, 3, 5, ...
  int terms = 0;
  double mean = 1;
  explicit HemisphereMeans(const HapkeParameters& parameters);
  double at(double cosine) const;
};

class HapkeLaw {
 public:
  explicit HapkeLaw(const HapkeParameters& parameters);

  // Calls visit.operator()<kLegendre, kOf2002>() for this law: loops over lanes need these as constants.
  template <class Visit>
  auto with_kind(const Visit& visit) const {
    if (legendre_) return of_2002_ ? visit.template operator()<true, true>() : visit.template operator()<true, false>();
    return of_2002_ ? visit.template operator()<false, true>() : visit.template operator()<false, false>();
  }
  double albedo() const { return w_; }

  // Returns mu0 f_r, sr-1, of ground with single-scattering albedo w, 0 to 1 (albedo() is the law's own). mu0 > 0, mu
  // >= 0.
  template <class Math, bool kLegendre, bool kOf2002>
  SELENOGRAPH_LANE double times_mu0(double mu0, double mu, double cos_phase, double w) const;

 private:
  // Effect of macroscopic roughness on the geometry.
  struct Tilted {
    double mu0, mu;                    // effective cosines
    double shadowing, over_shadowing;  // S = shadowing / over_shadowing
  };
  template <class Math>
  SELENOGRAPH_LANE Tilted tilted(double mu0, double mu, double cos_phase) const;
  template <bool kLegendre>
  SELENOGRAPH_LANE double particles(double cos_phase) const;
  // Returns 1 / H(x) of Hapke 2002. `r`: (1 - sqrt(1 - w)) / (1 + sqrt(1 - w)); `log`: logarithm of (1 + x) / x.
  SELENOGRAPH_LANE static double one_over_h(double x, double w, double r, double log) {
    return 1 - w * x * (r + (1 - 2 * r * x) / 2 * log);
  }
  // Returns P(x), 0 <= x <= 1, by a polynomial through Chebyshev nodes, with an error of 1e-5 for |b| up to 0.5 and
  // 1e-3 up to 0.85.
  SELENOGRAPH_LANE double hemisphere(double x) const;

  static constexpr int kDegree = 11;
  bool legendre_, of_2002_;
  double w_, b0_, h_, b_, c_, tan_theta_, cot_theta_, chi_, bc0_, inverse_hc_, mean_ = 1;
  double hemisphere_[kDegree + 1];  // coefficients of powers of 2 x - 1
};

template <bool kLegendre>
double HapkeLaw::particles(double x) const {
  if constexpr (kLegendre) return 1 + b_ * x + c_ * (1.5 * x * x - 0.5);
  const double base = 1 + b_ * b_, back = base - 2 * b_ * x, forward = base + 2 * b_ * x;
  const double back3 = back * std::sqrt(back), forward3 = forward * std::sqrt(forward);
  return (1 - b_ * b_) / 2 * ((1 + c_) * forward3 + (1 - c_) * back3) / (back3 * forward3);
}

double HapkeLaw::hemisphere(double x) const {
  const double y = 2 * x - 1;
  double sum = hemisphere_[kDegree];
#pragma GCC unroll 16
  for (int i = kDegree - 1; i >= 0; --i) sum = sum * y + hemisphere_[i];
  return sum;
}

template <class Math>
HapkeLaw::Tilted HapkeLaw::tilted(double mu0, double mu, double cos_phase) const {
  constexpr double kInversePi = 0.3183098861837907;
  // Bound the sine so that the product of two does not underflow: at a zenith the cotangent would be infinite, and 0
  // times it NaN.
  const auto sine_of = [](double cosine) {
    const double square = (1 - cosine) * (1 + cosine);
    return std::sqrt(square > 1e-300 ? square : 1e-300);
  };
  const double sin_i = sine_of(mu0), sin_e = sine_of(mu), sines = sin_i * sin_e, inverse = 1 / sines;
  // Azimuth between Sun and camera; if either is at the zenith, the azimuth does not matter.
  const double ratio = (cos_phase - mu0 * mu) * inverse;
  const double below_one = ratio < 1 ? ratio : 1.0, clamped = below_one > -1 ? below_one : -1.0;
  const double cos_psi = sines > 1e-149 ? clamped : 1.0;
  const double psi = Math::acos(cos_psi), sin2_half = (1 - cos_psi) / 2;
  const double f = Math::exp(-2 * std::sqrt((1 - cos_psi) / (1 + cos_psi)));
  // exp(-2 x / pi) and exp(-x^2 / pi) with x = cot theta_bar times the cotangent of the angle; 0 at a zenith.
  const double x_i = cot_theta_ * mu0 * sin_e * inverse, x_e = cot_theta_ * mu * sin_i * inverse;
  const double e1_i = Math::exp(-2 * kInversePi * x_i), e1_e = Math::exp(-2 * kInversePi * x_e);
  const double e2_i = Math::exp(-kInversePi * x_i * x_i), e2_e = Math::exp(-kInversePi * x_e * x_e);
  // eta = chi n / d.
  const double d_i = 2 - e1_i, d_e = 2 - e1_e, n_i = mu0 * d_i + sin_i * tan_theta_ * e2_i,
               n_e = mu * d_e + sin_e * tan_theta_ * e2_e;
  const bool steeper = mu0 >= mu;  // the Sun stands higher than the camera
  const double low1 = steeper ? e1_e : e1_i, low2 = steeper ? e2_e : e2_i, high1 = steeper ? e1_i : e1_e,
               high2 = steeper ? e2_i : e2_e;
  const double share = 1 / (2 - low1 - psi * kInversePi * high1);
  // Terms of the effective cosines: `above` of the source or camera that stands higher, `below` of the lower one.
  const double above = (cos_psi * low2 + sin2_half * high2) * share, below = (low2 - sin2_half * high2) * share;
  const double mu0e = chi_ * (mu0 + sin_i * tan_theta_ * (steeper ? above : below)),
               mue = chi_ * (mu + sin_e * tan_theta_ * (steeper ? below : above));
  // S = mue / eta_e mu0 / eta_i chi / (1 - f + f chi mu / eta), where the last mu and eta belong to the one that stands
  // higher.
  const double higher = steeper ? n_i : n_e, lower = steeper ? n_e : n_i, cosine = steeper ? mu0 * d_i : mu * d_e;
  const double shadowing = mue * mu0 * d_i * d_e, over = chi_ * lower * ((1 - f) * higher + f * cosine);
  const bool rough = tan_theta_ > 0;  // a smooth surface would give 0 / 0 at grazing emission
  return {mu0e, mue, rough ? shadowing : 1.0, rough ? over : 1.0};
}

template <class Math, bool kLegendre, bool kOf2002>
double HapkeLaw::times_mu0(double mu0, double mu, double cos_phase, double w) const {
  Tilted t = tilted<Math>(mu0, mu, cos_phase);
  // A slope that faces away reflects nothing. Apply this as a factor: a conditional around the computation could become
  // a branch.
  const double facing = t.mu0 > 0 && t.mu >= 0 ? 1.0 : 0.0;
  t.mu0 = t.mu0 > 1e-150 ? t.mu0 : 1e-150;
  t.mu = t.mu > 0 ? t.mu : 0.0;
  const double toward = 1 - cos_phase, away = 1 + cos_phase > 1e-300 ? 1 + cos_phase : 1e-300;
  const double sine = std::sqrt(toward > 0 ? toward * away : 0.0), width = h_ * away;  // tan(g / 2) = sine / away
  const double single = (1 + b0_ * width / (width + sine)) * particles<kLegendre>(cos_phase);
  const double root = std::sqrt(1 - w);
  double terms, coherent = 1;
  if constexpr (kOf2002) {
    const double r = (1 - root) / (1 + root), x0 = t.mu0, x = t.mu > 1e-150 ? t.mu : 1e-150, inverse = 1 / (x0 * x);
    const double over_in = one_over_h(x0, w, r, Math::log((1 + x0) * x * inverse)),
                 over_out = one_over_h(x, w, r, Math::log((1 + x) * x0 * inverse));
    const double joined = 1 / (over_in * over_out);
    const double in = (1 - over_in) * over_out * joined, out = (1 - over_out) * over_in * joined;  // H - 1
    terms = single + hemisphere(t.mu0) * out + hemisphere(t.mu) * in + mean_ * in * out;
    const double z = sine / away * inverse_hc_, safe = z > 1e-9 ? z : 1e-9;
    coherent += bc0_ * (1 - Math::exp(-safe) + safe) / (2 * safe * (1 + safe) * (1 + safe));
  } else {
    const double in = 2 * t.mu0, out = 2 * t.mu;
    terms = single - 1 + (1 + in) * (1 + out) / ((1 + in * root) * (1 + out * root));  // H(mu0) H(mu) - 1
  }
  return facing * w * 0.07957747154594767 * t.mu0 * t.shadowing * terms * coherent /
         ((t.mu0 + t.mu) * t.over_shadowing);
}

}  // namespace selenograph::engine
