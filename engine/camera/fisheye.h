// Fisheye projection by the angle from the boresight: Kannala & Brandt, "A generic camera model and calibration method
// for conventional, wide-angle, and fish-eye lenses", IEEE PAMI 28, 1335 (2006), eq. (6), as in OpenCV's fisheye
// module. Angles in radians, radii in focal lengths.
//
// The polynomial need not be monotonic. The field of view ends where its slope becomes zero (directions beyond would be
// imaged on top of others), and at kWidest at the latest.
#pragma once

#include <optional>

#include "dem/grid/geodesy.h"
#include "engine/frame/camera.h"

namespace selenograph::engine {

class Fisheye {
 public:
  // Widest angle from the boresight; the opposite direction would be imaged as a full circle.
  static constexpr double kWidest = 179 * kRadiansPerDegree;

  explicit Fisheye(const FisheyeDistortion& distortion);

  double radius(double theta) const;  // theta_d of the paper
  double slope(double theta) const;   // derivative of radius()

  // Largest imaged angle from the boresight.
  double limit() const { return limit_; }

  // Inverts radius(); empty beyond the limit.
  std::optional<double> angle(double radius) const;

  // Returns the unit direction, in camera axes, of an image position in focal lengths from the principal point; empty
  // beyond the limit.
  std::optional<Vec3> direction(double x, double y) const;

  // Returns an upper bound of the image scale, in focal lengths per radian, over directions between two angles from the
  // boresight: the larger of the radial and the tangential scale.
  double largest_scale(double from_theta, double to_theta) const;

 private:
  FisheyeDistortion d_;
  double limit_ = kWidest;
};

}  // namespace selenograph::engine
