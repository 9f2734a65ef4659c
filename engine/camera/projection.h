// Projection of a camera in both directions. Camera axes: +x right, +y down, +z along the boresight.
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

  // Returns the direction of an image position. A pinhole's direction has z = 1, so a distance along it is the depth. A
  // fisheye's, which may point behind that plane, has unit length. Empty where the lens images nothing.
  std::optional<Vec3> direction(double x_px, double y_px) const;

  // Returns the image position of a point; empty if it is behind a pinhole or the lens does not image it.
  std::optional<PixelXY> image(const Vec3& in_camera_m) const;

  const Lens& lens() const { return lens_; }  // lens of a pinhole
  const std::optional<Fisheye>& fisheye() const { return fisheye_; }

 private:
  Camera camera_;
  Lens lens_;
  std::optional<Fisheye> fisheye_;
};

}  // namespace selenograph::engine
