// A camera: pixels, focal lengths, lens. Axes are OpenCV's: +x right, +y down, +z along the boresight; the centre of
// the top-left pixel is (0, 0).
#pragma once

namespace selenograph::engine {

// Brown-Conrady (Brown 1966; OpenCV's coefficients): with r^2 = x^2 + y^2 on the plane z = 1,
//   x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
//   y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y
struct Distortion {
  double k1 = 0, k2 = 0, k3 = 0, p1 = 0, p2 = 0;
  bool none() const { return k1 == 0 && k2 == 0 && k3 == 0 && p1 == 0 && p2 == 0; }
};

struct Camera {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels
  Distortion distortion;
};

}  // namespace selenograph::engine
