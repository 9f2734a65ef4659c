// Radial part of a lens: the factor by which it moves a position on the plane z = 1 away from the axis, and the
// factor's derivatives, at the position's squared radius r^2 = x^2 + y^2.
//
//   polynomial   p(r)                     p(r) = 1 + k1 r^2 + k2 r^4 + k3 r^6 (Brown 1966)
//   rational     p(r) / q(r)              q(r) = 1 + k4 r^2 + k5 r^4 + k6 r^6 (OpenCV)
//   by angle     p(chi) chi / r           chi: radius that a lens without distortion gives to the angle atan r
//   (CAHVORE)
#pragma once

#include "engine/frame/camera.h"

namespace selenograph::engine {

class RadialFactor {
 public:
  // Largest radius at which a fold is searched, and at which a lens that is no polynomial images anything: tan 89.9
  // degrees.
  static constexpr double kFarthest = 574;

  // `linearity`: from chi = tan(linearity theta) / linearity of a positive one, chi = theta of 0, to
  // chi = sin(linearity theta) / linearity of a negative one (Gennery 2006). 1: chi = r.
  RadialFactor(const Distortion& distortion, double linearity);

  double at(double r2) const {
    return polynomial() ? 1 + r2 * (d_.k1 + r2 * (d_.k2 + r2 * d_.k3)) : no_polynomial_at(r2);
  }
  // Returns twice the derivative by r2, which is the derivative by the radius, over the radius.
  double twice_derivative(double r2) const {
    return polynomial() ? 2 * (d_.k1 + r2 * (2 * d_.k2 + r2 * 3 * d_.k3)) : no_polynomial_twice_derivative(r2);
  }
  // Returns the derivative of the distorted radius by the radius; positive until the radial part alone folds.
  double slope(double r2) const {
    return polynomial() ? 1 + r2 * (3 * d_.k1 + r2 * (5 * d_.k2 + r2 * 7 * d_.k3)) : no_polynomial_slope(r2);
  }
  // Returns a radius beyond which nothing is imaged, whatever the slope says: that of a rational lens's pole, or
  // kFarthest. Infinite for a polynomial.
  double end_radius() const { return end_radius_; }
  bool polynomial() const { return form_ == Form::polynomial; }

 private:
  enum class Form { polynomial, rational, by_angle };
  // Value and derivative of a function.
  struct Curve {
    double value, derivative;
  };
  double no_polynomial_at(double r2) const;
  double no_polynomial_twice_derivative(double r2) const;
  double no_polynomial_slope(double r2) const;
  Curve numerator(double r2) const;
  Curve denominator(double r2) const;
  double pole_r2() const;
  Curve radius_by_angle(double r) const;

  Distortion d_;
  double linearity_;
  Form form_;
  double end_radius_;
};

}  // namespace selenograph::engine
