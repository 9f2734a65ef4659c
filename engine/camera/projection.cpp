#include "engine/camera/projection.h"

#include <cmath>

namespace selenograph::engine {

Projection::Projection(const Camera& camera) : camera_(camera), lens_(camera) {
  if (camera.beyond_plane()) fisheye_.emplace(camera.fisheye);
}

std::optional<Vec3> Projection::direction(double x_px, double y_px) const {
  const double x = (x_px - camera_.cx) / camera_.fx, y = (y_px - camera_.cy) / camera_.fy;
  if (fisheye_) return fisheye_->direction(x, y);
  const auto p = lens_.undistorted(x, y);
  if (!p) return std::nullopt;
  return Vec3(p->x(), p->y(), 1);
}

std::optional<PixelXY> Projection::image(const Vec3& c) const {
  if (fisheye_) {
    const double across = std::hypot(c.x(), c.y()), theta = std::atan2(across, c.z());
    if (theta > fisheye_->limit()) return std::nullopt;
    const double scale = across > 0 ? fisheye_->radius(theta) / across : 0;
    return PixelXY{camera_.fx * scale * c.x() + camera_.cx, camera_.fy * scale * c.y() + camera_.cy};
  }
  if (!(c.z() > 0)) return std::nullopt;
  const double x = c.x() / c.z(), y = c.y() / c.z();
  if (!lens_.holds(x, y)) return std::nullopt;
  const Vec2 d = lens_.distorted(x, y);
  return PixelXY{camera_.fx * d.x() + camera_.cx, camera_.fy * d.y() + camera_.cy};
}

}  // namespace selenograph::engine
