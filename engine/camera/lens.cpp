#include "engine/camera/lens.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "dem/grid/rotation.h"

namespace selenograph::engine {
namespace {

// Returns where a direction meets the plane z = 1.
Vec2 on_plane(const Vec3& direction) { return direction.xy() / direction.z(); }

// Returns the derivative of the projective map by a position.
Mat2 projective_jacobian(const Mat3& map, const Vec2& position) {
  const Vec3 image = map * Vec3(position.x(), position.y(), 1);
  const Vec2 slope = on_plane(image);
  return Mat2(map.col(0).xy() - slope * map(2, 0), map.col(1).xy() - slope * map(2, 1)) / image.z();
}

// Returns true if a direction is nowhere near the edge of the plane z = 1: a lens's axis may be off the camera's, so
// that both have their limits.
bool is_within_reach(const Vec3& in_camera) { return in_camera.xy().norm() <= RadialFactor::kFarthest * in_camera.z(); }

// Returns the distortion of CAHVOR about its optical axis, without r0, which scales the whole image.
Distortion distortion_of(const Cahvor& cahvor) {
  Distortion distortion;
  distortion.k1 = cahvor.r[1] / (1 + cahvor.r[0]);
  distortion.k2 = cahvor.r[2] / (1 + cahvor.r[0]);
  return distortion;
}

}  // namespace

// OpenCV's computeTiltProjectionMatrix: the image on a sensor turned by R, along the lens's axis.
std::optional<Lens::Planes> Lens::planes_of(const Distortion& d) {
  if (d.tau_x_deg == 0 && d.tau_y_deg == 0) return std::nullopt;
  const double tau_x = d.tau_x_deg * kRadiansPerDegree, tau_y = d.tau_y_deg * kRadiansPerDegree;
  const double cos_x = std::cos(tau_x), sin_x = std::sin(tau_x), cos_y = std::cos(tau_y), sin_y = std::sin(tau_y);
  const Mat3 about_x({1, 0, 0}, {0, cos_x, -sin_x}, {0, sin_x, cos_x});
  const Mat3 about_y({cos_y, 0, sin_y}, {0, 1, 0}, {-sin_y, 0, cos_y});
  const Mat3 turn = about_y * about_x;
  const Mat3 along_axis({turn(2, 2), 0, 0}, {0, turn(2, 2), 0}, {-turn(0, 2), -turn(1, 2), 1});
  Planes planes;
  planes.image_from_lens = along_axis * turn;
  planes.lens_from_image = planes.image_from_lens.inverse();
  return planes;
}

// The rows of the image matrix are those of (H, V, A), in focal lengths from the principal point.
std::optional<Lens::Planes> Lens::planes_of(const Cahvor& c) {
  Planes planes;
  planes.lens_from_camera = shortest_turn(c.o, Vec3::unit_z()).matrix();
  const Mat3 image_from_camera = Mat3::from_rows((c.h - c.cx() * c.a) / c.fx(), (c.v - c.cy() * c.a) / c.fy(), c.a);
  planes.image_from_lens = image_from_camera * planes.lens_from_camera.transpose();
  for (int i = 0; i < 2; ++i) planes.image_from_lens.col(i) *= 1 + c.r[0];
  planes.lens_from_image = planes.image_from_lens.inverse();
  return planes;
}

Lens::Lens(const Distortion& distortion) : distortion_(distortion), planes_(planes_of(distortion)) {}

Lens::Lens(const Camera& camera)
    : distortion_(camera.cahvor ? PlaneDistortion(distortion_of(*camera.cahvor), camera.cahvor->linearity)
                                : PlaneDistortion(camera.distortion)),
      planes_(camera.cahvor ? planes_of(*camera.cahvor) : planes_of(camera.distortion)),
      sights_(camera.sights) {}

Vec2 Lens::distorted(double x, double y) const {
  if (sights_) return sights_->image({x, y}).value_or(Vec2(x, y));
  if (!planes_) return distortion_.distorted(x, y);
  const Vec2 p = on_plane(planes_->lens_from_camera * Vec3(x, y, 1));
  const Vec2 bent = distortion_.distorted(p.x(), p.y());
  return on_plane(planes_->image_from_lens * Vec3(bent.x(), bent.y(), 1));
}

Mat2 Lens::jacobian(double x, double y) const {
  if (sights_) return sights_->jacobian({x, y});
  if (!planes_) return distortion_.jacobian(x, y);
  const Vec2 p = on_plane(planes_->lens_from_camera * Vec3(x, y, 1));
  return projective_jacobian(planes_->image_from_lens, distortion_.distorted(p.x(), p.y())) *
         distortion_.jacobian(p.x(), p.y()) * projective_jacobian(planes_->lens_from_camera, {x, y});
}

std::optional<Vec2> Lens::undistorted(double xd, double yd) const {
  if (sights_) return sights_->plane({xd, yd});
  if (!planes_) return distortion_.undistorted(xd, yd);
  const Vec3 bent = planes_->lens_from_image * Vec3(xd, yd, 1);
  if (!(bent.z() > 0)) return std::nullopt;
  const auto p = distortion_.undistorted(bent.x() / bent.z(), bent.y() / bent.z());
  if (!p) return std::nullopt;
  const Vec3 in_camera = planes_->lens_from_camera.transpose_times({p->x(), p->y(), 1});
  if (!is_within_reach(in_camera)) return std::nullopt;
  return on_plane(in_camera);
}

bool Lens::holds(double x, double y) const {
  if (sights_) return sights_->image({x, y}).has_value();
  if (!planes_) return distortion_.holds(x, y);
  const Vec3 p = planes_->lens_from_camera * Vec3(x, y, 1);
  if (!(p.z() > 0 && is_within_reach({x, y, 1}) && distortion_.holds(p.x() / p.z(), p.y() / p.z()))) return false;
  const Vec2 bent = distortion_.distorted(p.x() / p.z(), p.y() / p.z());
  return planes_->image_from_lens.row(2).dot({bent.x(), bent.y(), 1}) > 0;
}

double Lens::reach() const {
  if (sights_) return sights_->reach();
  if (!planes_) return distortion_.reach();
  const Vec3 axis = planes_->lens_from_camera.row(2);
  const double widest = std::atan(distortion_.reach()) + std::atan2(std::hypot(axis.x(), axis.y()), axis.z());
  return widest < std::numbers::pi / 2 ? std::min(std::tan(widest), RadialFactor::kFarthest) : RadialFactor::kFarthest;
}

// The lens stretches by at most the larger eigenvalue of its Jacobian's symmetric part, and by the rest of it, which is
// 0 for Brown's lens.
Lens::Scale Lens::scale(double focal_px, const Vec2& position) const {
  const Mat2 jacobian = this->jacobian(position.x(), position.y());
  const Mat2 symmetric = (jacobian + jacobian.transpose()) / 2;
  const double r2 = position.squared_norm(), half_trace = symmetric.trace() / 2;
  const double stretch = std::abs(half_trace) +
                         std::sqrt(std::max(0.0, half_trace * half_trace - symmetric.determinant())) +
                         std::abs(jacobian(0, 1) - jacobian(1, 0)) / 2;
  // On the plane z = 1 an angle covers up to (1 + r^2), along the radius.
  if (!planes_ && !sights_ && distortion_.is_brown()) return {focal_px * stretch, focal_px * (1 + r2) * stretch};
  // Across the radius it covers only the root of that. Toward 90 degrees from the axis, where lenses compress the
  // radius, the product of both bounds would exceed the scale many times.
  const double along = 1 + r2, across = std::sqrt(along);
  Mat2 plane_from_angle = across * Mat2::identity();
  if (r2 > 0) plane_from_angle += outer((along - across) / r2 * position, position);
  const Mat2 m = jacobian * plane_from_angle;
  const double largest =
      (std::hypot(m(0, 0) + m(1, 1), m(0, 1) - m(1, 0)) + std::hypot(m(0, 0) - m(1, 1), m(0, 1) + m(1, 0))) / 2;
  return {focal_px * stretch, focal_px * largest};
}

}  // namespace selenograph::engine
