// Brown-Conrady distortion and its inverse, on the plane z = 1 of the camera.
//
// A strong polynomial is not invertible everywhere: it maps places far from the axis back into the image. Distortion is
// used only where it is invertible: a place is valid when the Jacobian of the map (symmetric, since the map is a
// gradient) stays positive definite along the straight line from the axis to that place.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>

#include "engine/frame/camera.h"

namespace selenograph::engine {

class Lens {
 public:
  explicit Lens(const Distortion& distortion);

  Eigen::Vector2d distorted(double x, double y) const;
  Eigen::Matrix2d jacobian(double x, double y) const;

  // Inverse of distorted(); empty where no valid place is mapped here.
  std::optional<Eigen::Vector2d> undistorted(double xd, double yd) const;

  // Whether the map is invertible between the axis and this place.
  bool holds(double x, double y) const;

  // Upper bound on the radius of valid places; infinite when the map is invertible everywhere.
  double reach() const { return reach_; }

 private:
  std::optional<Eigen::Vector2d> radially_undistorted(const Eigen::Vector2d& wanted) const;
  std::optional<Eigen::Vector2d> corrected(Eigen::Vector2d from, const Eigen::Vector2d& wanted) const;
  std::optional<Eigen::Vector2d> walked_to(const Eigen::Vector2d& wanted) const;
  double fold_radius(double direction_x, double direction_y) const;
  double safe_radius() const;

  Distortion d_;
  double safe_ = std::numeric_limits<double>::infinity();   // all places nearer than this are valid
  double reach_ = std::numeric_limits<double>::infinity();  // no place farther out is valid
};

}  // namespace selenograph::engine
