#include "engine/camera/plane_distortion.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace selenograph::engine {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

// Returns the vector whose product with the position is the Jacobian of the thin-prism terms.
Vec2 prism_gradient(const Distortion& d, double r2) { return {2 * d.s1 + 4 * d.s2 * r2, 2 * d.s3 + 4 * d.s4 * r2}; }

// Returns true if a Jacobian is that of a map without a fold; a symmetric one is then positive definite.
bool is_positive(const Mat2& jacobian) { return jacobian.trace() > 0 && jacobian.determinant() > 1e-12; }

// Returns the first radius at which is_valid(r) fails; infinite beyond RadialFactor::kFarthest.
template <typename IsValid>
double first_invalid(IsValid&& is_valid) {
  double low = 0, high = 0.002;
  while (is_valid(high)) {
    low = high;
    high *= 1.01;
    if (high > RadialFactor::kFarthest) return kInfinite;
  }
  for (int i = 0; i < 60; ++i) (is_valid((low + high) / 2) ? low : high) = (low + high) / 2;
  return low;
}

}  // namespace

PlaneDistortion::PlaneDistortion(const Distortion& distortion, double linearity)
    : d_(distortion),
      radial_(distortion, linearity),
      has_prism_(distortion.s1 != 0 || distortion.s2 != 0 || distortion.s3 != 0 || distortion.s4 != 0),
      is_radial_(distortion.p1 == 0 && distortion.p2 == 0 && !has_prism_),
      is_identity_(linearity == 1 && distortion.without_tilt().none()) {
  if (is_identity_) return;
  valid_radius_ = max_radius_ = std::min(safe_radius(), radial_.end_radius());
  if (is_radial_) return;
  // With tangential and prism terms the radius of the fold depends on the direction; it varies little between the
  // sampled ones.
  constexpr int kDirections = 32;
  for (int i = 0; i < kDirections; ++i) {
    const double angle = 2 * std::numbers::pi * i / kDirections;
    max_radius_ = std::max(max_radius_, 1.05 * fold_radius(std::cos(angle), std::sin(angle)));
  }
  max_radius_ = std::min(max_radius_, radial_.end_radius());
}

Vec2 PlaneDistortion::distorted(double x, double y) const {
  const double r2 = x * x + y * y, k = radial_.at(r2);
  const Vec2 p{x * k + 2 * d_.p1 * x * y + d_.p2 * (r2 + 2 * x * x),
               y * k + d_.p1 * (r2 + 2 * y * y) + 2 * d_.p2 * x * y};
  if (!has_prism_) return p;
  return p + r2 * Vec2(d_.s1 + d_.s2 * r2, d_.s3 + d_.s4 * r2);
}

Mat2 PlaneDistortion::jacobian(double x, double y) const {
  const double r2 = x * x + y * y, k = radial_.at(r2), dk = radial_.twice_derivative(r2);
  const double mixed = x * y * dk + 2 * d_.p1 * x + 2 * d_.p2 * y;
  Mat2 jacobian({k + x * x * dk + 2 * d_.p1 * y + 6 * d_.p2 * x, mixed},
                {mixed, k + y * y * dk + 6 * d_.p1 * y + 2 * d_.p2 * x});
  if (has_prism_) jacobian += outer(prism_gradient(d_, r2), {x, y});
  return jacobian;
}

double PlaneDistortion::fold_radius(double direction_x, double direction_y) const {
  return first_invalid([&](double r) { return is_positive(jacobian(r * direction_x, r * direction_y)); });
}

// Returns a radius within which every position is valid: the symmetric part of the Jacobian stays positive definite.
// The radial part's eigenvalues are the factor and its slope; the tangential part's are at least -6 |p| r, those of the
// prism's at least -r times the length of its gradient.
double PlaneDistortion::safe_radius() const {
  const double tangential = 6 * std::hypot(d_.p1, d_.p2);
  return first_invalid([&](double r) {
    const double r2 = r * r, least = std::min(radial_.at(r2), radial_.slope(r2)) - tangential * r;
    return r < radial_.end_radius() && (has_prism_ ? least - prism_gradient(d_, r2).norm() * r : least) > 0;
  });
}

bool PlaneDistortion::holds(double x, double y) const {
  const double r = std::hypot(x, y);
  if (r <= valid_radius_) return true;
  if (r > max_radius_) return false;
  constexpr int kSteps = 64;
  for (int i = 1; i <= kSteps; ++i)
    if (!is_positive(jacobian(x * i / kSteps, y * i / kSteps))) return false;
  return true;
}

// Returns the position whose image is the target, by Newton's method from p with the exact Jacobian, in steps that stay
// within the fold. It converges quadratically, so a failure means that the target is beyond the fold: then empty.
std::optional<Vec2> PlaneDistortion::corrected(Vec2 p, const Vec2& target) const {
  Mat2 slope_matrix = jacobian(p.x(), p.y());
  for (int i = 0; i < 50; ++i) {
    Vec2 step = slope_matrix.inverse() * (distorted(p.x(), p.y()) - target);
    const double max_step = 0.5 * std::max(0.1, p.norm());
    if (step.norm() > max_step) step *= max_step / step.norm();
    constexpr int kMaxHalvings = 8;
    int halvings = 0;
    for (; halvings < kMaxHalvings; ++halvings, step /= 2) {
      slope_matrix = jacobian(p.x() - step.x(), p.y() - step.y());
      if (is_positive(slope_matrix)) break;
    }
    if (halvings == kMaxHalvings) return std::nullopt;
    p -= step;
    if (step.norm() <= 1e-15 * (1 + p.norm())) break;
  }
  if ((distorted(p.x(), p.y()) - target).norm() > 1e-11 * (1 + target.norm())) return std::nullopt;
  return p;
}

// Solves for targets along the line from the axis, each from the solution before, for targets that one Newton iteration
// does not reach.
std::optional<Vec2> PlaneDistortion::continued_from_axis(const Vec2& target) const {
  constexpr int kSteps = 64;
  std::optional<Vec2> p = Vec2::zero();
  for (int i = 1; i <= kSteps && p; ++i) p = corrected(*p, target * i / kSteps);
  return p;
}

// Returns the position whose image is the target, for a lens with radial terms only; empty beyond the fold. Only the
// radius changes, and it grows up to the fold: Newton's method between brackets.
std::optional<Vec2> PlaneDistortion::radially_undistorted(const Vec2& target) const {
  const double target_radius = target.norm();
  if (target_radius == 0) return target;
  const auto mapped = [&](double r) { return r * radial_.at(r * r); };
  double low = 0, high = std::min(max_radius_, 1.0);
  while (mapped(high) < target_radius) {
    if (high == max_radius_ || high > 1e100) return std::nullopt;
    low = high;
    high = std::min(max_radius_, 2 * high);
  }
  double r = std::min(high, target_radius);
  for (int i = 0; i < 200 && high - low > 1e-16 * high; ++i) {
    const double miss = mapped(r) - target_radius;
    (miss > 0 ? high : low) = r;
    const double next = r - miss / radial_.slope(r * r);
    if (std::abs(next - r) <= 1e-16 * r) break;
    r = next > low && next < high ? next : (low + high) / 2;
  }
  return target * (r / target_radius);
}

std::optional<Vec2> PlaneDistortion::undistorted(double xd, double yd) const {
  const Vec2 target(xd, yd);
  if (is_identity_) return target;
  if (is_radial_) return radially_undistorted(target);
  Vec2 start = target;
  if (start.norm() > valid_radius_) start *= 0.9 * valid_radius_ / start.norm();
  auto p = corrected(start, target);
  if (p && holds(p->x(), p->y())) return p;
  p = continued_from_axis(target);
  return p && holds(p->x(), p->y()) ? p : std::nullopt;
}

}  // namespace selenograph::engine
