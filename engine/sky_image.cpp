#include "engine/sky_image.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

namespace selenograph::engine {

namespace {

// What rows with views of their own see of a sky, each object once per row near which it is: within `reach_px` of it.
struct SeenByRows {
  std::vector<SkyObject> sky;
  std::vector<int> rows;
};
SeenByRows seen_by_rows(const std::vector<SkyObject>& sky, const RowViews& views, double reach_px,
                        const StopToken& stop) {
  SeenByRows out;
  for (const SkyObject& object : sky) {
    stop.check();
    for (const ViewBundle& bundle : views.bundles()) {
      const Vec3 far_m = bundle.view.position() + kStarDistance_m * object.direction;
      if (!bundle.may_see(far_m, reach_px / bundle.view.least_pixels_per_metre(far_m, 0))) continue;
      for (int row = bundle.first_row; row < bundle.past_last_row; ++row) {
        const View& view = views.of(row);
        const auto pixel = view.project(view.position() + kStarDistance_m * object.direction);
        const double below = pixel ? pixel->y - views.line(row) : reach_px;
        if (!(std::abs(below) < reach_px)) continue;
        SkyObject& here = out.sky.emplace_back(object);
        here.x_px = pixel->x, here.y_px = row + below;
        out.rows.push_back(row);
      }
    }
  }
  return out;
}

}  // namespace

SkyImage::SkyImage(const FrameRequest& request, int spread_px, const dem::Terrain& terrain, RenderCache& kept,
                   const StopToken& stop)
    : camera_(request.camera) {
  if (!request.sky || !request.sky->any()) return;
  const RowViews views(request.camera, request.pose, request.shutter, stop);
  constexpr double kSquare_px = 1;  // a point beside the image leaves half of its square in it
  std::vector<SkyObject> sky = sky_around(request, views, kSquare_px, stop);
  std::erase_if(sky, [&](const SkyObject& o) {
    return o.kind == SkyKind::sun || o.kind == SkyKind::earth || !(o.x_px > -1 && o.x_px < camera_.width) ||
           !(o.y_px > -1 && o.y_px < camera_.height);
  });
  std::vector<int> rows;
  if (views.vary()) {
    SeenByRows seen = seen_by_rows(sky, views, 1 + spread_px, stop);
    sky = std::move(seen.sky), rows = std::move(seen.rows);
  }
  find_hidden(request, views, terrain, kept, stop, sky);
  for (std::size_t i = 0; i < sky.size(); ++i) {
    const SkyObject& object = sky[i];
    const auto sr = object.hidden_by == HiddenBy::none ? pixel_sr(views, object.x_px, object.y_px) : std::nullopt;
    if (!sr) continue;
    const int row = std::clamp(static_cast<int>(std::lround(object.y_px)), 0, camera_.height - 1);
    points_.push_back({{object.x_px, object.y_px, views.of(row).moon_from_camera().transpose() * object.direction,
                        object.counted_w_m2 / *sr, rows.empty() ? std::nullopt : std::optional(rows[i])},
                       object.irradiance_w_m2 / *sr});
  }
}

void SkyImage::add_to(std::vector<float>& radiance) const {
  for (const Point& point : points_)
    add_square(radiance, camera_.width, camera_.height, point.light.x_px, point.light.y_px, point.radiance_w_m2_sr,
               point.light.row);
}

std::vector<LightPoint> SkyImage::points(int margin_px) const {
  std::vector<LightPoint> points;
  points.reserve(points_.size());
  for (const Point& point : points_) {
    points.push_back(point.light);
    points.back().x_px -= margin_px, points.back().y_px -= margin_px;
    if (auto& row = points.back().row) *row -= margin_px;
  }
  return points;
}

}  // namespace selenograph::engine
