// A camera's two maps: from a place in the image to a direction, and back. In camera axes: +x right, +y down, +z along
// the boresight.
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

  // Of a pinhole scaled so that its z is 1: a distance along it is the depth. Of a fisheye, which may look behind that
  // plane, of unit length. Empty where the lens images nothing: such a pixel sees nothing.
  std::optional<Vec3> direction(double x_px, double y_px) const;

  // Image place of a point; empty behind a pinhole and where the lens images nothing.
  std::optional<PixelXY> image(const Vec3& in_camera_m) const;

  const Lens& lens() const { return lens_; }  // a pinhole's
  const std::optional<Fisheye>& fisheye() const { return fisheye_; }

 private:
  Camera camera_;
  Lens lens_;
  std::optional<Fisheye> fisheye_;
};

}  // namespace selenograph::engine
