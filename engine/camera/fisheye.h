// The fisheye's projection, by the angle from the boresight: Kannala & Brandt, "A generic camera model and calibration
// method for conventional, wide-angle, and fish-eye lenses", IEEE PAMI 28, 1335 (2006), eq. (6), as OpenCV's fisheye
// has it. Angles in radians, radii in focal lengths.
//
// The polynomial may turn around: places farther out would be imaged on top of others. The field of view ends there,
// and at the latest at kWidest.
#pragma once

#include <optional>

#include "dem/grid/geodesy.h"
#include "engine/frame/camera.h"

namespace selenograph::engine {

class Fisheye {
 public:
  // Straight behind the camera one direction would be imaged as a circle: a pixel there covers nothing.
  static constexpr double kWidest = 179 * kRadiansPerDegree;

  explicit Fisheye(const FisheyeDistortion& distortion);

  double radius(double theta) const;  // theta_d
  double slope(double theta) const;   // its derivative

  // The largest angle from the boresight that is imaged, and its radius.
  double limit() const { return limit_; }
  double limit_radius() const { return radius(limit_); }

  // The angle that is imaged at a radius; empty beyond the limit.
  std::optional<double> angle(double radius) const;

  // Unit direction in camera axes of a place in focal lengths from the principal point; empty beyond the limit.
  std::optional<Vec3> direction(double x, double y) const;

  // Upper bound on how far an image point moves, in focal lengths, per radian that a direction between two angles from
  // the boresight turns: the larger of the radial and the tangential scale.
  double largest_scale(double from_theta, double to_theta) const;

 private:
  FisheyeDistortion d_;
  double limit_ = kWidest;
};

}  // namespace selenograph::engine
