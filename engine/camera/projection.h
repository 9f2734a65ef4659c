// Projection of a camera, both ways: image place to direction and back. Camera axes: +x right, +y down, +z along the
// boresight.
#pragma once

#include <optional>

#include "engine/camera/fisheye.h"
#include "engine/camera/lens.h"
#include "engine/frame/camera.h"

namespace selenograph::engine {

struct PixelXY {
  double x, y;
};

class Projection {
 public:
  explicit Projection(const Camera& camera);

  // For a pinhole the direction has z = 1, so a distance along it is the depth. For a fisheye, which may look behind
  // that plane, it has unit length. Empty where the lens images nothing.
  std::optional<Vec3> direction(double x_px, double y_px) const;

  // Image place of a point; empty when it is behind a pinhole or the lens does not image it.
  std::optional<PixelXY> image(const Vec3& in_camera_m) const;

  const Lens& lens() const { return lens_; }  // of a pinhole
  const std::optional<Fisheye>& fisheye() const { return fisheye_; }

 private:
  Camera camera_;
  Lens lens_;
  std::optional<Fisheye> fisheye_;
};

}  // namespace selenograph::engine
