// A camera: pixels, focal lengths, lens. Axes are OpenCV's: +x right, +y down, +z along the boresight; the centre of
// the top-left pixel is (0, 0).
#pragma once

#include <memory>
#include <optional>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

class SightTable;

// Brown-Conrady (Brown 1966) and the rest of OpenCV's model, with OpenCV's coefficients: with r^2 = x^2 + y^2 on the
// plane z = 1 and the radial factor f = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6),
//   x' = x f + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4
//   y' = y f + p1 (r^2 + 2 y^2) + 2 p2 x y + s3 r^2 + s4 r^4
// on a sensor tilted by tau_x about x and then by tau_y about y.
struct Distortion {
  double k1 = 0, k2 = 0, k3 = 0, p1 = 0, p2 = 0;
  double k4 = 0, k5 = 0, k6 = 0;          // rational
  double s1 = 0, s2 = 0, s3 = 0, s4 = 0;  // thin prism
  double tau_x_deg = 0, tau_y_deg = 0;
  bool none() const { return *this == Distortion{}; }
  // Returns true if the terms beyond Brown-Conrady are 0.
  bool is_brown() const { return *this == Distortion{k1, k2, k3, p1, p2}; }
  Distortion without_tilt() const { return {k1, k2, k3, p1, p2, k4, k5, k6, s1, s2, s3, s4}; }
  bool operator==(const Distortion&) const = default;
};

// Kannala-Brandt (Kannala & Brandt 2006; the coefficients of OpenCV's fisheye): a direction at the angle theta from the
// boresight is imaged at the radius, in focal lengths,
//   theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8).
// All zero: the equidistant fisheye.
struct FisheyeDistortion {
  double k1 = 0, k2 = 0, k3 = 0, k4 = 0;
  bool operator==(const FisheyeDistortion&) const = default;
};

// CAHVOR (Yakimovsky & Cunningham 1978; Gennery 2006) and CAHVORE, with the projection centre C in the origin: a
// direction p = z o + q, with q perpendicular to o, is first moved to p' = z' o + (1 + r0 + r1 chi^2 + r2 chi^4) q,
// with chi = |q| / z' as in RadialFactor (engine/camera/radial_factor.h), and then imaged at the pixel (h . p' / a .
// p', v . p' / a . p'). Vectors are in camera axes.
struct Cahvor {
  Vec3 a = Vec3::unit_z(), h = Vec3::unit_x(), v = Vec3::unit_y();  // a: unit vector; h and v: pixels
  Vec3 o = Vec3::unit_z();                                          // unit vector of the optical axis
  Vec3 r = Vec3::zero();
  double linearity = 1;  // 1: CAHVOR; CAHVORE: from -1 to 1, 0 for its fisheye

  // Focal lengths and principal point, pixels.
  double fx() const { return a.cross(h).norm(); }
  double fy() const { return a.cross(v).norm(); }
  double cx() const { return a.dot(h); }
  double cy() const { return a.dot(v); }
  bool operator==(const Cahvor&) const = default;
};

enum class CameraModel {
  pinhole,  // radius = tan theta, then `distortion` or `cahvor`; or `sights`
  fisheye   // radius = theta_d of `fisheye`
};

struct Camera {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels
  Distortion distortion{};                // for a pinhole
  CameraModel model = CameraModel::pinhole;
  FisheyeDistortion fisheye{};
  std::optional<Cahvor> cahvor{};  // for a pinhole without `distortion`, whose fx, fy, cx and cy are the vectors'
  // For a pinhole without either, whose fx, fy, cx and cy are those that fit the table; null: none.
  std::shared_ptr<const SightTable> sights{};
  // Returns true if straight lines are imaged as straight lines: a pixel's direction is linear in its coordinates.
  bool rectilinear() const { return model == CameraModel::pinhole && distortion.none() && !cahvor && !sights; }
  // Returns true if directions beyond 90 degrees from the boresight may be imaged. They have no position on the plane z
  // = 1: such a camera is described by a radius per angle (engine/camera/fisheye.h) and rendered by ray tracing only.
  bool beyond_plane() const { return model != CameraModel::pinhole; }
  bool operator==(const Camera&) const = default;
};

}  // namespace selenograph::engine
