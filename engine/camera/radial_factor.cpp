#include "engine/camera/radial_factor.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace selenograph::engine {

RadialFactor::RadialFactor(const Distortion& distortion, double linearity)
    : d_(distortion), linearity_(linearity), form_(Form::polynomial), end_radius_(kFarthest) {
  if (linearity != 1) {
    form_ = Form::by_angle;
  } else if (d_.k4 != 0 || d_.k5 != 0 || d_.k6 != 0) {
    form_ = Form::rational;
    end_radius_ = std::min(end_radius_, std::sqrt(pole_r2()));
  } else {
    end_radius_ = std::numeric_limits<double>::infinity();
  }
}

// Derivatives are by r2.
RadialFactor::Curve RadialFactor::numerator(double r2) const {
  return {1 + r2 * (d_.k1 + r2 * (d_.k2 + r2 * d_.k3)), d_.k1 + r2 * (2 * d_.k2 + r2 * 3 * d_.k3)};
}

RadialFactor::Curve RadialFactor::denominator(double r2) const {
  return {1 + r2 * (d_.k4 + r2 * (d_.k5 + r2 * d_.k6)), d_.k4 + r2 * (2 * d_.k5 + r2 * 3 * d_.k6)};
}

// Returns the smallest positive root of the denominator, below the square of kFarthest; infinite without one. Between
// the roots of its derivative, a quadratic, the denominator is monotonic: bisect the first such interval that ends
// below zero.
double RadialFactor::pole_r2() const {
  constexpr double kEnd = kFarthest * kFarthest;
  double ends[3] = {kEnd, kEnd, kEnd};
  const double a = 3 * d_.k6, b = d_.k5, discriminant = b * b - a * d_.k4;  // of a r^4 + 2 b r^2 + k4
  if (discriminant >= 0) {
    const double q = -(b + std::copysign(std::sqrt(discriminant), b));
    int count = 0;
    for (const double root : {q / a, d_.k4 / q})
      if (root > 0 && root < kEnd) ends[count++] = root;
    std::sort(ends, ends + 2);
  }
  double low = 0;
  for (double high : ends) {
    if (denominator(high).value <= 0) {
      for (int i = 0; i < 100; ++i) (denominator((low + high) / 2).value > 0 ? low : high) = (low + high) / 2;
      return low;
    }
    low = high;
  }
  return std::numeric_limits<double>::infinity();
}

// Returns the distorted radius and its derivative by the radius: chi p(chi), with theta = atan r. A linearity whose
// square rounds to nothing is 0.
RadialFactor::Curve RadialFactor::radius_by_angle(double r) const {
  constexpr double kMinLinearity = 1e-9;
  const double theta = std::atan(r), a = linearity_ * theta;
  Curve chi{theta, 1};
  if (linearity_ > kMinLinearity) {
    const double t = std::tan(a);
    chi = {t / linearity_, 1 + t * t};
  } else if (linearity_ < -kMinLinearity) {
    chi = {std::sin(a) / linearity_, std::cos(a)};
  }
  const double c2 = chi.value * chi.value;
  const Curve p = numerator(c2);
  return {chi.value * p.value, (p.value + 2 * c2 * p.derivative) * chi.derivative / (1 + r * r)};
}

double RadialFactor::no_polynomial_at(double r2) const {
  if (form_ == Form::rational) return numerator(r2).value / denominator(r2).value;
  const double r = std::sqrt(r2);
  return r > 0 ? radius_by_angle(r).value / r : 1;
}

double RadialFactor::no_polynomial_twice_derivative(double r2) const {
  if (form_ == Form::by_angle) return r2 > 0 ? (slope(r2) - at(r2)) / r2 : 0;
  const Curve n = numerator(r2), q = denominator(r2);
  return 2 * (n.derivative * q.value - n.value * q.derivative) / (q.value * q.value);
}

double RadialFactor::no_polynomial_slope(double r2) const {
  if (form_ == Form::by_angle) return radius_by_angle(std::sqrt(r2)).derivative;
  return at(r2) + r2 * twice_derivative(r2);
}

}  // namespace selenograph::engine
