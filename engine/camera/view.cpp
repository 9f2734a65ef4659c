#include "engine/camera/view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "dem/base/error.h"

namespace selenograph::engine {

View::View(const Camera& camera, const Pose& pose) : camera_(camera), projection_(camera) {
  if (camera.width <= 0 || camera.height <= 0) throw ImpossibleRequest("camera: image without pixels");
  if (!(std::isfinite(camera.fx) && std::isfinite(camera.fy) && camera.fx > 0 && camera.fy > 0 &&
        std::isfinite(camera.cx) && std::isfinite(camera.cy)))
    throw ImpossibleRequest("camera: focal lengths must be positive and finite");
  set_pose(pose);
  if (projection_.fisheye())
    bound_fisheye_image();
  else
    bound_image();
}

View View::at(const Pose& pose) const {
  View moved = *this;
  moved.set_pose(pose);
  return moved;
}

void View::set_pose(const Pose& pose) {
  position_ = pose.position_m;
  camera_from_moon_ = pose.camera_from_moon.normalized().matrix();
  if (!position_.is_finite() || !camera_from_moon_.is_finite()) throw ImpossibleRequest("pose: not finite");
  moon_from_camera_ = camera_from_moon_.transpose();
}

Vec3 View::middle() const {
  if (projection_.fisheye())
    return ray((camera_.width - 1) / 2.0, (camera_.height - 1) / 2.0).value_or(Vec3(moon_from_camera_.col(2)));
  return (moon_from_camera_ * Vec3((left_ + right_) / 2, (top_ + bottom_) / 2, 1)).normalized();
}

std::optional<Vec3> View::ray(double x_px, double y_px) const {
  const auto d = projection_.direction(x_px, y_px);
  return d ? std::optional<Vec3>(moon_from_camera_ * *d) : std::nullopt;
}

std::optional<PixelXY> View::project(const Vec3& point_m) const {
  return projection_.image(camera_from_moon_ * (point_m - position_));
}

// Samples the image to bound the slopes of its rays and the scale of the image.
void View::bound_image() {
  // Right and lower end of the image, half a pixel outside the centres of the border's pixels; it begins at -0.5.
  const double right_end_px = camera_.width - 0.5, bottom_end_px = camera_.height - 0.5;
  constexpr int kSamples = 64;
  // Margins for the gaps between samples. A scale that swings once across the image is at most 1 / cos(2 pi / 128) - 1
  // = 0.12 % larger there: 1 % is ample. A bound moves by less than a step between samples, 1/64 of the image or 1.6 %:
  // add 2 % and, for images without extent, a little more.
  constexpr double kScaleMargin = 1.01, kBoundMargin = 0.02, kMinMargin = 1e-9;
  left_ = top_ = std::numeric_limits<double>::infinity();
  right_ = bottom_ = -left_;
  const Lens& lens = projection_.lens();
  double max_pixels_per_radian = 0;
  bool folds = false;
  for (int j = 0; j <= kSamples; ++j)
    for (int i = 0; i <= kSamples; ++i) {
      const double x_px = -0.5 + (right_end_px + 0.5) * i / kSamples,
                   y_px = -0.5 + (bottom_end_px + 0.5) * j / kSamples;
      const auto plane_point = lens.undistorted((x_px - camera_.cx) / camera_.fx, (y_px - camera_.cy) / camera_.fy);
      folds |= !plane_point;
      if (!plane_point) continue;
      left_ = std::min(left_, plane_point->x());
      right_ = std::max(right_, plane_point->x());
      top_ = std::min(top_, plane_point->y());
      bottom_ = std::max(bottom_, plane_point->y());
      const Lens::Scale scale = lens.scale(std::max(camera_.fx, camera_.fy), *plane_point);
      max_pixels_per_radian = std::max(max_pixels_per_radian, scale.px_per_radian);
      stretched_focal_ = std::max(stretched_focal_, scale.px_per_slope * kScaleMargin);
      widest_ = std::max(widest_, plane_point->norm());
    }
  pixels_per_radian_ = max_pixels_per_radian * kScaleMargin;
  if (left_ > right_) return;  // no pixel has a ray: nothing is in view
  if (folds) {
    // Toward the fold a pixel covers ever more, so no sample bounds the view: take the fold itself.
    constexpr double kFarthestSlope = 1000;  // tan 89.94 degrees: directions beyond cover next to no pixels
    widest_ = std::min(lens.reach(), kFarthestSlope);
    left_ = top_ = -widest_;
    right_ = bottom_ = widest_;
  }
  const double margin_x = kBoundMargin * (right_ - left_) + kMinMargin,
               margin_y = kBoundMargin * (bottom_ - top_) + kMinMargin;
  left_ -= margin_x;
  right_ += margin_x;
  top_ -= margin_y;
  bottom_ += margin_y;
  // Normalise the planes through the camera and the sides of the image; see outside_image().
  const auto per_length = [](double slope) { return 1 / std::sqrt(1 + slope * slope); };
  per_length_ = {per_length(left_), per_length(right_), per_length(top_), per_length(bottom_)};
}

// Bounds the angle from the boresight over the image.
void View::bound_fisheye_image() {
  // The corner farthest from the principal point has the largest angle.
  const double x = std::max(camera_.cx + 0.5, camera_.width - 0.5 - camera_.cx) / camera_.fx,
               y = std::max(camera_.cy + 0.5, camera_.height - 0.5 - camera_.cy) / camera_.fy;
  widest_theta_ = projection_.fisheye()->angle(std::hypot(x, y)).value_or(projection_.fisheye()->limit());
}

bool View::fisheye_may_see(const Vec3& in_camera_m, double radius_m) const {
  const double distance = in_camera_m.norm();
  if (distance <= radius_m) return true;
  const double theta = std::acos(std::clamp(in_camera_m.z() / distance, -1.0, 1.0));
  constexpr double kRounding = 1e-7;  // rounding of acos next to the boresight
  return theta - std::asin(radius_m / distance) <= widest_theta_ + kRounding;
}

// Returns the distances outside the planes through the camera and the image's sides, and behind the camera; negative
// inside.
std::array<double, 5> View::outside_image(const Vec3& in_camera_m) const {
  const double x = in_camera_m.x(), y = in_camera_m.y(), z = in_camera_m.z();
  return {-z, (left_ * z - x) * per_length_[0], (x - right_ * z) * per_length_[1], (top_ * z - y) * per_length_[2],
          (y - bottom_ * z) * per_length_[3]};
}

bool View::may_see(const Vec3& centre_m, double radius_m) const {
  const Vec3 c = camera_from_moon_ * (centre_m - position_);
  if (projection_.fisheye()) return fisheye_may_see(c, radius_m);
  if (left_ > right_) return false;
  const std::array<double, 5> distances = outside_image(c);
  return *std::max_element(distances.begin(), distances.end()) <= radius_m;
}

// The convex hull of the points is outside the image if all of them are outside one side.
bool View::may_see(std::span<const Vec3> points_m, double margin_m) const {
  if (projection_.fisheye()) return true;
  if (left_ > right_) return false;
  std::array<double, 5> nearest;
  nearest.fill(std::numeric_limits<double>::infinity());
  for (const Vec3& p : points_m) {
    const std::array<double, 5> distances = outside_image(camera_from_moon_ * (p - position_));
    for (std::size_t i = 0; i < nearest.size(); ++i) nearest[i] = std::min(nearest[i], distances[i]);
  }
  return *std::max_element(nearest.begin(), nearest.end()) <= margin_m;
}

double View::pixels_per_metre_from(double nearest_m) const {
  const double per_radian =
      projection_.fisheye() ? std::max(camera_.fx, camera_.fy) * projection_.fisheye()->largest_scale(0, widest_theta_)
                            : pixels_per_radian_;
  return per_radian / std::max(nearest_m, 1e-3);
}

// Bounds the scale by distance and, for a ball in front of a pinhole, also by depth; the smaller bound holds.
double View::pixels_per_metre(const Vec3& centre_m, double radius_m, double highest_m) const {
  const Vec3 c = camera_from_moon_ * (centre_m - position_);
  // From inside the ball, the nearest distance is still the height above everything in it.
  const double nearest = std::max(c.norm() - radius_m, position_.norm() - kMoonRadius_m - highest_m);
  if (projection_.fisheye()) {
    const double theta = std::atan2(std::hypot(c.x(), c.y()), c.z()),
                 half_angle = radius_m < c.norm() ? std::asin(radius_m / c.norm()) : std::numbers::pi;
    const double scale =
        projection_.fisheye()->largest_scale(theta - half_angle, std::min(theta + half_angle, widest_theta_));
    return std::max(camera_.fx, camera_.fy) * scale / std::max(nearest, 1e-3);
  }
  const double by_angle = pixels_per_radian_ / std::max(nearest, 1e-3);
  const double depth = c.z() - radius_m;
  if (!(depth > 1e-3)) return by_angle;
  // A displacement e moves the image point (x/z, y/z) by at most |e| sqrt(1 + r^2) / z.
  const double r = std::min(widest_, (std::hypot(c.x(), c.y()) + radius_m) / depth);
  return std::min(by_angle, stretched_focal_ * std::sqrt(1 + r * r) / depth);
}

double View::least_pixels_per_metre(const Vec3& centre_m, double radius_m) const {
  if (projection_.fisheye()) return 0;
  return std::min(pixels_per_radian_, stretched_focal_) / std::max((centre_m - position_).norm() + radius_m, 1e-3);
}

}  // namespace selenograph::engine
