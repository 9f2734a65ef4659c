#include "engine/camera/lens.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace selenograph::engine {
namespace {

constexpr double kFarthest = 574;  // 89.9 degrees off axis is far enough
constexpr double kNever = std::numeric_limits<double>::infinity();

double radial(const Distortion& d, double r2) { return 1 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3)); }

// d(r * radial(r^2)) / dr: positive as long as the radial part alone doesn't fold.
double radial_slope(const Distortion& d, double r2) { return 1 + r2 * (3 * d.k1 + r2 * (5 * d.k2 + r2 * 7 * d.k3)); }

bool positive_definite(const Eigen::Matrix2d& symmetric) {
  return symmetric.trace() > 0 && symmetric.determinant() > 1e-12;
}

// The first radius at which `good(r)` no longer holds.
template <typename Good>
double first_bad(Good&& good) {
  double low = 0, high = 0.002;
  while (good(high)) {
    low = high;
    high *= 1.01;
    if (high > kFarthest) return kNever;
  }
  for (int i = 0; i < 60; ++i) (good((low + high) / 2) ? low : high) = (low + high) / 2;
  return low;
}

}  // namespace

Lens::Lens(const Distortion& distortion) : d_(distortion) {
  if (d_.none()) return;
  safe_ = reach_ = safe_radius();
  if (d_.p1 == 0 && d_.p2 == 0) return;
  // With tangential terms the fold's radius depends on the direction; between those looked into it varies little.
  constexpr int kDirections = 32;
  for (int i = 0; i < kDirections; ++i) {
    const double angle = 2 * std::numbers::pi * i / kDirections;
    reach_ = std::max(reach_, 1.05 * fold_radius(std::cos(angle), std::sin(angle)));
  }
}

Eigen::Vector2d Lens::distorted(double x, double y) const {
  const double r2 = x * x + y * y, k = radial(d_, r2);
  return {x * k + 2 * d_.p1 * x * y + d_.p2 * (r2 + 2 * x * x), y * k + d_.p1 * (r2 + 2 * y * y) + 2 * d_.p2 * x * y};
}

Eigen::Matrix2d Lens::jacobian(double x, double y) const {
  const double r2 = x * x + y * y, k = radial(d_, r2);
  const double dk = 2 * (d_.k1 + r2 * (2 * d_.k2 + r2 * 3 * d_.k3));  // d(radial)/d(r2), twice
  const double mixed = x * y * dk + 2 * d_.p1 * x + 2 * d_.p2 * y;
  Eigen::Matrix2d jacobian;
  jacobian << k + x * x * dk + 2 * d_.p1 * y + 6 * d_.p2 * x, mixed, mixed,
      k + y * y * dk + 6 * d_.p1 * y + 2 * d_.p2 * x;
  return jacobian;
}

double Lens::fold_radius(double direction_x, double direction_y) const {
  return first_bad([&](double r) { return positive_definite(jacobian(r * direction_x, r * direction_y)); });
}

// The radial part's eigenvalues are radial and radial_slope; the tangential part's are at least -6 |p| r.
double Lens::safe_radius() const {
  const double tangential = 6 * std::hypot(d_.p1, d_.p2);
  return first_bad([&](double r) { return std::min(radial(d_, r * r), radial_slope(d_, r * r)) - tangential * r > 0; });
}

bool Lens::holds(double x, double y) const {
  const double r = std::hypot(x, y);
  if (r <= safe_) return true;
  if (r > reach_) return false;
  constexpr int kSteps = 64;
  for (int i = 1; i <= kSteps; ++i)
    if (!positive_definite(jacobian(x * i / kSteps, y * i / kSteps))) return false;
  return true;
}

// Newton's method with the exact Jacobian, in steps that stay on this side of the fold; converges quadratically, so
// that a failure means beyond it.
std::optional<Eigen::Vector2d> Lens::corrected(Eigen::Vector2d p, const Eigen::Vector2d& wanted) const {
  Eigen::Matrix2d slope = jacobian(p.x(), p.y());
  for (int i = 0; i < 50; ++i) {
    Eigen::Vector2d step = slope.inverse() * (distorted(p.x(), p.y()) - wanted);
    const double longest = 0.5 * std::max(0.1, p.norm());
    if (step.norm() > longest) step *= longest / step.norm();
    constexpr int kShortest = 8;
    int halved = 0;
    for (; halved < kShortest; ++halved, step /= 2) {
      slope = jacobian(p.x() - step.x(), p.y() - step.y());
      if (positive_definite(slope)) break;
    }
    if (halved == kShortest) return std::nullopt;
    p -= step;
    if (step.norm() <= 1e-15 * (1 + p.norm())) break;
  }
  if ((distorted(p.x(), p.y()) - wanted).norm() > 1e-11 * (1 + wanted.norm())) return std::nullopt;
  return p;
}

// From the axis outwards in small steps, for what one leap can't reach.
std::optional<Eigen::Vector2d> Lens::walked_to(const Eigen::Vector2d& wanted) const {
  constexpr int kSteps = 64;
  std::optional<Eigen::Vector2d> p = Eigen::Vector2d::Zero();
  for (int i = 1; i <= kSteps && p; ++i) p = corrected(*p, wanted * i / kSteps);
  return p;
}

// Without tangential terms only the radius changes, and it grows up to the fold: Newton's method between brackets.
std::optional<Eigen::Vector2d> Lens::radially_undistorted(const Eigen::Vector2d& wanted) const {
  const double target = wanted.norm();
  if (target == 0) return wanted;
  const auto mapped = [&](double r) { return r * radial(d_, r * r); };
  double low = 0, high = std::min(reach_, 1.0);
  while (mapped(high) < target) {
    if (high == reach_ || high > 1e100) return std::nullopt;
    low = high;
    high = std::min(reach_, 2 * high);
  }
  double r = std::min(high, target);
  for (int i = 0; i < 200 && high - low > 1e-16 * high; ++i) {
    const double miss = mapped(r) - target;
    (miss > 0 ? high : low) = r;
    const double next = r - miss / radial_slope(d_, r * r);
    if (std::abs(next - r) <= 1e-16 * r) break;
    r = next > low && next < high ? next : (low + high) / 2;
  }
  return wanted * (r / target);
}

std::optional<Eigen::Vector2d> Lens::undistorted(double xd, double yd) const {
  const Eigen::Vector2d wanted(xd, yd);
  if (d_.none()) return wanted;
  if (d_.p1 == 0 && d_.p2 == 0) return radially_undistorted(wanted);
  Eigen::Vector2d start = wanted;
  if (start.norm() > safe_) start *= 0.9 * safe_ / start.norm();
  auto p = corrected(start, wanted);
  if (p && holds(p->x(), p->y())) return p;
  p = walked_to(wanted);
  return p && holds(p->x(), p->y()) ? p : std::nullopt;
}

}  // namespace selenograph::engine
