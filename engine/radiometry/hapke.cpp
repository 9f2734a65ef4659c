#include "engine/radiometry/hapke.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

double phase_function(const HapkeParameters& k, double cos_phase) {
  if (k.phase_function == PhaseFunction::legendre)
    return 1 + k.b * cos_phase + k.c * (1.5 * cos_phase * cos_phase - 0.5);
  const auto lobe = [&](double x) { return (1 - k.b * k.b) / std::pow(1 + k.b * k.b - 2 * k.b * x, 1.5); };
  return (1 + k.c) / 2 * lobe(cos_phase) + (1 - k.c) / 2 * lobe(-cos_phase);
}

HemisphereMeans::HemisphereMeans(const HapkeParameters& k) {
  double a = -0.5;  // A_1; A_n is 0 for even n
  for (int i = 0; i < kMaxTerms; ++i) {
    const int n = 2 * i + 1;
    const double b_n =
        k.phase_function == PhaseFunction::legendre ? (n == 1 ? k.b : 0.0) : k.c * (2 * n + 1) * std::pow(k.b, n);
    if (std::abs(b_n) < 1e-9) break;
    odd[terms++] = a * b_n;
    mean += a * a * b_n;
    // (-1)^((n + 1) / 2) / n 1 3 5 ... n / (2 4 6 ... (n + 1))
    a *= -static_cast<double>(n) / (n + 3);
  }
}

double HemisphereMeans::at(double x) const {
  double sum = 1, before = 1, now = x;  // P_0, P_1
  for (int i = 0; i < terms; ++i) {
    sum += odd[i] * now;
    for (int n = 2 * i + 1; n < 2 * i + 3; ++n) {
      const double next = ((2 * n + 1) * x * now - n * before) / (n + 1);
      before = now;
      now = next;
    }
  }
  return sum;
}

HapkeLaw::HapkeLaw(const HapkeParameters& k)
    : legendre_(k.phase_function == PhaseFunction::legendre),
      of_2002_(k.terms == HapkeTerms::terms_2002),
      w_(k.w),
      b0_(k.b0),
      h_(k.h),
      b_(k.b),
      c_(k.c),
      tan_theta_(std::tan(k.theta_bar_deg * kRadiansPerDegree)),
      cot_theta_(tan_theta_ > 0 ? 1 / tan_theta_ : 1e150),
      chi_(1 / std::sqrt(1 + std::numbers::pi * tan_theta_ * tan_theta_)),
      bc0_(k.bc0),
      inverse_hc_(1 / std::max(k.hc, 1e-300)) {
  const HemisphereMeans means(k);
  mean_ = means.mean;
  // Chebyshev series from values at the nodes; T_n is kept as powers of 2 x - 1 by its recurrence.
  constexpr int kNodes = kDegree + 1;
  std::fill(std::begin(hemisphere_), std::end(hemisphere_), 0.0);
  double before[kNodes] = {1}, now[kNodes] = {0, 1};  // T_0, T_1
  for (int n = 0; n < kNodes; ++n) {
    double share = 0;
    for (int node = 0; node < kNodes; ++node) {
      const double angle = (node + 0.5) * std::numbers::pi / kNodes;
      share += (n == 0 ? 1.0 : 2.0) / kNodes * std::cos(n * angle) * means.at((1 + std::cos(angle)) / 2);
    }
    for (int i = 0; i < kNodes; ++i) hemisphere_[i] += share * before[i];
    double next[kNodes];
    for (int i = 0; i < kNodes; ++i) next[i] = (i > 0 ? 2 * now[i - 1] : 0) - before[i];
    std::copy_n(now, kNodes, before);
    std::copy_n(next, kNodes, now);
  }
}

}  // namespace selenograph::engine
