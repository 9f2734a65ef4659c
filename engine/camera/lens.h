// Brown-Conrady distortion and its inverse, on the plane z = 1 of the camera.
//
//   distorted radius                         A strong polynomial folds: positions beyond the fold are mapped
//      ^        __ fold                      back into the image. Only positions within the fold are valid:
//      |     .'    `.                        the Jacobian of the map (symmetric, as the map is a gradient)
//      |   .'  valid  `.  mapped back        stays positive definite along the straight line from the axis.
//      | .'             `.
//      +-----------------> undistorted radius
#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>

#include "engine/frame/camera.h"

namespace selenograph::engine {

class Lens {
 public:
  explicit Lens(const Distortion& distortion);

  // Maps an undistorted position to the distorted one.
  Eigen::Vector2d distorted(double x, double y) const;
  Eigen::Matrix2d jacobian(double x, double y) const;

  // Inverts distorted(); empty if no valid position is mapped here.
  std::optional<Eigen::Vector2d> undistorted(double xd, double yd) const;

  // Returns true if the map is invertible between the axis and this position.
  bool holds(double x, double y) const;

  // Upper bound of the radius of valid positions; infinite if the map is invertible everywhere.
  double reach() const { return max_radius_; }

 private:
  std::optional<Eigen::Vector2d> radially_undistorted(const Eigen::Vector2d& target) const;
  std::optional<Eigen::Vector2d> corrected(Eigen::Vector2d from, const Eigen::Vector2d& target) const;
  std::optional<Eigen::Vector2d> continued_from_axis(const Eigen::Vector2d& target) const;
  double fold_radius(double direction_x, double direction_y) const;
  double safe_radius() const;

  Distortion d_;
  double valid_radius_ = std::numeric_limits<double>::infinity();  // all positions within this radius are valid
  double max_radius_ = std::numeric_limits<double>::infinity();    // no position beyond this radius is valid
};

}  // namespace selenograph::engine
