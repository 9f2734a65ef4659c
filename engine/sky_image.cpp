#include "engine/sky_image.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace selenograph::engine {

SkyImage::SkyImage(const FrameRequest& request, const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop)
    : camera_(request.camera) {
  if (!request.sky || !request.sky->any()) return;
  const RowViews views(request.camera, request.pose, request.shutter, stop);
  constexpr double kSquare_px = 1;  // a point beside the image leaves half of its square in it
  std::vector<SkyObject> sky = sky_around(request, views, kSquare_px, stop);
  std::erase_if(sky, [&](const SkyObject& o) {
    return o.kind == SkyKind::sun || o.kind == SkyKind::earth || !(o.x_px > -1 && o.x_px < camera_.width) ||
           !(o.y_px > -1 && o.y_px < camera_.height);
  });
  find_hidden(request, views, terrain, kept, stop, sky);
  for (const SkyObject& object : sky) {
    const auto sr = object.hidden_by == HiddenBy::none ? pixel_sr(views, object.x_px, object.y_px) : std::nullopt;
    if (!sr) continue;
    const int row = std::clamp(static_cast<int>(std::lround(object.y_px)), 0, camera_.height - 1);
    points_.push_back({{object.x_px, object.y_px, views.of(row).moon_from_camera().transpose() * object.direction,
                        object.counted_w_m2 / *sr},
                       object.irradiance_w_m2 / *sr});
  }
}

void SkyImage::add_to(std::vector<float>& radiance) const {
  for (const Point& point : points_)
    add_square(radiance, camera_.width, camera_.height, point.light.x_px, point.light.y_px, point.radiance_w_m2_sr);
}

std::vector<LightPoint> SkyImage::points(int margin_px) const {
  std::vector<LightPoint> points;
  points.reserve(points_.size());
  for (const Point& point : points_) {
    points.push_back(point.light);
    points.back().x_px -= margin_px, points.back().y_px -= margin_px;
  }
  return points;
}

}  // namespace selenograph::engine
