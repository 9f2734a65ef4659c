// Lens of a pinhole, on the plane z = 1 of the camera: distortion about the lens's axis, between two projective maps
// for a lens or a sensor that is not square to the camera's axes.
//
//   camera plane --rotation--> lens plane --PlaneDistortion--> lens plane --homography--> image, in focal lengths
//     z = 1                     lens axis = z                                             from the principal point
//
// Brown's and OpenCV's lenses have the camera's axis; OpenCV's tilt (tau_x, tau_y) is a homography. CAHVOR's optical
// axis O gives the rotation, its vectors A, H and V the homography (Gennery 2006). A table of lines of sight is all of
// it in one.
#pragma once

#include <memory>
#include <optional>

#include "engine/camera/plane_distortion.h"
#include "engine/camera/sight_table.h"
#include "engine/frame/camera.h"

namespace selenograph::engine {

class Lens {
 public:
  // The lens of a camera whose model is the pinhole.
  explicit Lens(const Camera& camera);
  explicit Lens(const Distortion& distortion);

  // Maps an undistorted position to the distorted one. The position must hold.
  Vec2 distorted(double x, double y) const;
  Mat2 jacobian(double x, double y) const;

  // Inverts distorted(); empty if no valid position is mapped here.
  std::optional<Vec2> undistorted(double xd, double yd) const;

  // Returns true if the map is invertible between the axis and this position.
  bool holds(double x, double y) const;

  // Upper bound of the radius of valid positions; infinite if the map is invertible everywhere.
  double reach() const;

  // Upper bounds of the image scale in any direction, at a position on the plane.
  struct Scale {
    double px_per_slope, px_per_radian;
  };
  Scale scale(double focal_px, const Vec2& position) const;

 private:
  struct Planes {
    Mat3 lens_from_camera = Mat3::identity();  // rotation
    Mat3 image_from_lens = Mat3::identity();
    Mat3 lens_from_image = Mat3::identity();
  };
  static std::optional<Planes> planes_of(const Distortion& distortion);
  static std::optional<Planes> planes_of(const Cahvor& cahvor);

  PlaneDistortion distortion_;
  std::optional<Planes> planes_;              // empty: both maps are the identity
  std::shared_ptr<const SightTable> sights_;  // null: none; else all the rest is unused
};

}  // namespace selenograph::engine
