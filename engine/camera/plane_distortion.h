// Distortion of positions on the plane z = 1 about the lens's axis, and its inverse: radial, tangential and thin-prism
// terms.
//
//   distorted radius                         A strong lens folds: positions beyond the fold are mapped back into
//      ^        __ fold                      the image. Only positions within the fold are valid: the Jacobian of
//      |     .'    `.                        the map stays positive (its determinant and its trace) along the
//      |   .'  valid  `.  mapped back        straight line from the axis. Without thin-prism terms the map is a
//      | .'             `.                   gradient: the Jacobian is symmetric and stays positive definite.
//      +-----------------> undistorted radius
#pragma once

#include <limits>
#include <optional>

#include "engine/camera/radial_factor.h"
#include "engine/frame/camera.h"

namespace selenograph::engine {

class PlaneDistortion {
 public:
  // The tilt of `distortion` is left out. `linearity` as in RadialFactor.
  explicit PlaneDistortion(const Distortion& distortion, double linearity = 1);

  // Maps an undistorted position to the distorted one.
  Vec2 distorted(double x, double y) const;
  Mat2 jacobian(double x, double y) const;

  // Inverts distorted(); empty if no valid position is mapped here.
  std::optional<Vec2> undistorted(double xd, double yd) const;

  // Returns true if the map is invertible between the axis and this position.
  bool holds(double x, double y) const;

  // Upper bound of the radius of valid positions; infinite if the map is invertible everywhere.
  double reach() const { return max_radius_; }

  // Returns true for a polynomial without thin-prism terms: Brown's.
  bool is_brown() const { return radial_.polynomial() && !has_prism_; }

 private:
  std::optional<Vec2> radially_undistorted(const Vec2& target) const;
  std::optional<Vec2> corrected(Vec2 from, const Vec2& target) const;
  std::optional<Vec2> continued_from_axis(const Vec2& target) const;
  double fold_radius(double direction_x, double direction_y) const;
  double safe_radius() const;

  Distortion d_;
  RadialFactor radial_;
  bool has_prism_, is_radial_, is_identity_;
  double valid_radius_ = std::numeric_limits<double>::infinity();  // all positions within this radius are valid
  double max_radius_ = std::numeric_limits<double>::infinity();    // no position beyond this radius is valid
};

}  // namespace selenograph::engine
