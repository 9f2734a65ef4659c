// A camera: pixels, focal lengths, lens. Axes are OpenCV's: +x right, +y down, +z along the boresight; the centre of
// the top-left pixel is (0, 0).
#pragma once

namespace selenograph::engine {

// Brown-Conrady (Brown 1966; OpenCV's coefficients): with r^2 = x^2 + y^2 on the plane z = 1,
//   x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
//   y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y
struct Distortion {
  double k1 = 0, k2 = 0, k3 = 0, p1 = 0, p2 = 0;
  bool none() const { return *this == Distortion{}; }
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

enum class CameraModel {
  pinhole,  // radius = tan theta, then `distortion`
  fisheye   // radius = theta_d of `fisheye`
};

struct Camera {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels
  Distortion distortion{};                // for a pinhole
  CameraModel model = CameraModel::pinhole;
  FisheyeDistortion fisheye{};
  // Returns true if straight lines are imaged as straight lines: a pixel's direction is linear in its coordinates.
  bool rectilinear() const { return model == CameraModel::pinhole && distortion.none(); }
  // Returns true if directions beyond 90 degrees from the boresight may be imaged. They have no position on the plane z
  // = 1: such a camera is described by a radius per angle (engine/camera/fisheye.h) and rendered by ray tracing only.
  bool beyond_plane() const { return model != CameraModel::pinhole; }
  bool operator==(const Camera&) const = default;
};

}  // namespace selenograph::engine
