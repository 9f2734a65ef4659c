// Brown-Conrady distortion and its inverse, on the plane z = 1 of the camera.
//
// The polynomial folds where it is strong: places far out are mapped back into the image, on top of others. The lens
// ends there. A place belongs to it when the map, on the straight way from the axis to the place, never turns: its
// Jacobian (which is symmetric: the map is a gradient) stays positive definite.
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

  // The one place of the lens that is mapped here; empty beyond the fold.
  std::optional<Eigen::Vector2d> undistorted(double xd, double yd) const;

  // Whether a place comes before the fold.
  bool holds(double x, double y) const;

  // No place farther out than this belongs to it; infinite when it doesn't fold.
  double reach() const { return reach_; }

 private:
  std::optional<Eigen::Vector2d> radially_undistorted(const Eigen::Vector2d& wanted) const;
  std::optional<Eigen::Vector2d> corrected(Eigen::Vector2d from, const Eigen::Vector2d& wanted) const;
  std::optional<Eigen::Vector2d> walked_to(const Eigen::Vector2d& wanted) const;
  double fold_radius(double direction_x, double direction_y) const;
  double safe_radius() const;

  Distortion d_;
  double safe_ = std::numeric_limits<double>::infinity();   // all places nearer than this belong to it
  double reach_ = std::numeric_limits<double>::infinity();  // none farther
};

}  // namespace selenograph::engine
