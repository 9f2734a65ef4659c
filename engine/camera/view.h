// One camera at one pose: pixels to directions and back, and visibility of bounding volumes.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "engine/camera/projection.h"
#include "engine/frame/camera.h"
#include "engine/frame/pose.h"

namespace selenograph::engine {

class View {
 public:
  // Throws ImpossibleRequest for an invalid camera or pose.
  View(const Camera& camera, const Pose& pose);
  // Returns the same camera at another pose, with the same image bounds.
  View at(const Pose& pose) const;

  const Camera& camera() const { return camera_; }
  const Vec3& position() const { return position_; }
  const Mat3& moon_from_camera() const { return moon_from_camera_; }
  // Returns the unit direction of the image's middle. It differs from the boresight if the image is a crop of a larger
  // one.
  Vec3 middle() const;

  // Returns the direction (MOON_ME) of an image position, scaled as in Projection::direction. Empty where the lens
  // images nothing.
  std::optional<Vec3> ray(double x_px, double y_px) const;

  // Returns the depth, the distance along the boresight, of a point at `distance` along such a ray.
  double depth(const Vec3& ray, double distance) const {
    return projection_.fisheye() ? distance * moon_from_camera_.col(2).dot(ray) : distance;
  }

  const Projection& projection() const { return projection_; }
  // Upper bound of sqrt(x^2 + y^2) / z of a pinhole's rays.
  double widest_slope() const { return widest_; }

  // Returns the image position of a point; empty if it is behind a pinhole or the lens does not image it.
  std::optional<PixelXY> project(const Vec3& point_m) const;

  // Returns false if a sphere is certainly outside the image.
  bool may_see(const Vec3& centre_m, double radius_m) const;
  // Returns false if everything within `margin_m` of the convex hull of some points is certainly outside the image.
  bool may_see(std::span<const Vec3> points_m, double margin_m) const;

  // Returns an upper bound of pixels per metre, across the line of sight, of anything within the sphere and not higher
  // above the datum than highest_m.
  double pixels_per_metre(const Vec3& centre_m, double radius_m,
                          double highest_m = std::numeric_limits<double>::infinity()) const;
  // Returns a lower bound of pixels_per_metre() over all smaller spheres within this one; 0 if none is known.
  double least_pixels_per_metre(const Vec3& centre_m, double radius_m) const;
  // Returns an upper bound of pixels per metre of anything at least this far away, in any direction.
  double pixels_per_metre_from(double nearest_m) const;

 private:
  void set_pose(const Pose& pose);
  void bound_image();
  void bound_fisheye_image();
  std::array<double, 5> outside_image(const Vec3& in_camera_m) const;
  bool fisheye_may_see(const Vec3& in_camera_m, double radius_m) const;

  Camera camera_;
  Projection projection_;
  Vec3 position_;
  Mat3 camera_from_moon_, moon_from_camera_;
  // slopes x/z and y/z of the image border, enlarged by a small margin
  double left_ = 0, right_ = 0, top_ = 0, bottom_ = 0;
  std::array<double, 4> per_length_{};  // 1 / length of the vectors (1, slope), in that order
  double pixels_per_radian_ = 0, stretched_focal_ = 0;
  double widest_ = 0;        // largest slope sqrt(x^2 + y^2) / z in the image
  double widest_theta_ = 0;  // fisheye: largest angle from the boresight in the image
};

}  // namespace selenograph::engine
