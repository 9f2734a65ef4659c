#include "engine/camera/fisheye.h"

#include <algorithm>
#include <cmath>

namespace selenograph::engine {

// Sets limit_ to the first fold, where the radius stops growing with the angle, found by steps and then bisection.
Fisheye::Fisheye(const FisheyeDistortion& distortion) : d_(distortion) {
  // Steps of 1/4096 find every fold that matters: a slope that dips below zero for less than a thousandth of the field
  // of view folds less than a pixel.
  constexpr int kSteps = 4096;
  for (int i = 1; i <= kSteps; ++i) {
    double unfolded = kWidest * (i - 1) / kSteps, folded = kWidest * i / kSteps;
    if (slope(folded) > 0) continue;
    for (int k = 0; k < 60; ++k) (slope((unfolded + folded) / 2) > 0 ? unfolded : folded) = (unfolded + folded) / 2;
    limit_ = unfolded;
    return;
  }
}

double Fisheye::radius(double theta) const {
  const double t = theta * theta;
  return theta * (1 + t * (d_.k1 + t * (d_.k2 + t * (d_.k3 + t * d_.k4))));
}

double Fisheye::slope(double theta) const {
  const double t = theta * theta;
  return 1 + t * (3 * d_.k1 + t * (5 * d_.k2 + t * (7 * d_.k3 + t * 9 * d_.k4)));
}

// Newton's method between brackets, which works because the radius grows up to the limit.
std::optional<double> Fisheye::angle(double target_radius) const {
  double low = 0, high = limit_;
  if (!(target_radius <= radius(high))) return std::nullopt;
  double theta = std::min(target_radius, high);
  for (int i = 0; i < 200 && high - low > 1e-16 * high; ++i) {
    const double miss = radius(theta) - target_radius;
    (miss > 0 ? high : low) = theta;
    const double next = theta - miss / slope(theta);
    if (std::abs(next - theta) <= 1e-16 * theta) break;
    theta = next > low && next < high ? next : (low + high) / 2;
  }
  return theta;
}

std::optional<Vec3> Fisheye::direction(double x, double y) const {
  const double r = std::hypot(x, y);
  const auto theta = angle(r);
  if (!theta) return std::nullopt;
  const double across = r > 0 ? std::sin(*theta) / r : 1;
  return Vec3(across * x, across * y, std::cos(*theta));
}

// Takes the larger of the radial scale, d radius / d theta, and the tangential one, radius / sin(theta).
double Fisheye::largest_scale(double from_theta, double to_theta) const {
  const double from = std::clamp(from_theta, 0.0, limit_), to = std::clamp(to_theta, 0.0, limit_);
  // Both scales are smooth; a margin of 2 % covers the gaps between samples (tests/unit/fisheye_test.cpp).
  constexpr int kSamples = 32;
  double largest = 0;
  for (int i = 0; i <= kSamples; ++i) {
    const double theta = from + (to - from) * i / kSamples;
    const double tangential = theta > 0 ? radius(theta) / std::sin(theta) : 1;
    largest = std::max({largest, slope(theta), tangential});
  }
  return 1.02 * largest;
}

}  // namespace selenograph::engine
