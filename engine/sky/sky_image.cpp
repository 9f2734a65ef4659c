#include "engine/sky/sky_image.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "dem/base/error.h"
#include "engine/cache/render_context.h"
#include "engine/frame/needs.h"

namespace selenograph::engine {

// Returns an object's positions in the image, one for each row within `reach_px` of it, because each row has a view of
// its own. If all these rows see it at the same position, returns that once, for kAllRows.
std::vector<SkyImage::ImagePoint> SkyImage::image_points_of(const SkyObject& object, double reach_px) const {
  std::vector<ImagePoint> points;
  for (const ViewBundle& bundle : views_->bundles()) {
    const Vec3 far_m = bundle.view.position() + kStarDistance_m * object.direction;
    if (!bundle.may_see(far_m, reach_px / bundle.view.least_pixels_per_metre(far_m, 0))) continue;
    for (int row = bundle.first_row; row < bundle.past_last_row; ++row) {
      const View& view = views_->of(row);
      const auto pixel = view.project(view.position() + kStarDistance_m * object.direction);
      const double below_row_px = pixel ? pixel->y - views_->line(row) : reach_px;
      if (std::abs(below_row_px) < reach_px && pixel->x > -reach_px && pixel->x < camera_.width - 1 + reach_px)
        points.push_back({pixel->x, row + below_row_px, row, 0});
    }
  }
  constexpr double kTolerance_px = 1e-6;
  const auto equals_first = [&](const ImagePoint& p) {
    return std::abs(p.x_px - points[0].x_px) < kTolerance_px && std::abs(p.y_px - points[0].y_px) < kTolerance_px;
  };
  if (points.empty() || !std::all_of(points.begin(), points.end(), equals_first)) return points;
  // kAllRows stands for all rows within reach: it does not fit if any of them lacks a point.
  const int first = std::max(0, static_cast<int>(std::floor(points[0].y_px - reach_px)) + 1),
            last = std::min(views_->height(), static_cast<int>(std::ceil(points[0].y_px + reach_px))) - 1;
  if (points.size() != static_cast<std::size_t>(last - first + 1)) return points;
  return {{points[0].x_px, points[0].y_px, kAllRows, 0}};
}

// Removes objects that no row images. Sets the others' positions to those nearest to their rows, and records the points
// of all rows.
void SkyImage::locate(const FrameRequest& request, double reach_px, std::vector<SkyObject>& sky,
                      const StopToken& stop) {
  constexpr std::size_t kMaxImagePoints = 64 * kMostStars;
  std::vector<SkyObject> imaged;
  for (SkyObject& object : sky) {
    stop.check();
    std::vector<ImagePoint> points;
    if (views_->vary())
      points = image_points_of(object, reach_px);
    else if (object.x_px > -1 && object.x_px < camera_.width && object.y_px > -1 && object.y_px < camera_.height)
      points = {{object.x_px, object.y_px, kAllRows, 0}};
    if (points.empty()) continue;
    const auto distance_to_row_px = [](const ImagePoint& p) {
      return p.row == kAllRows ? 0 : std::abs(p.y_px - p.row);
    };
    const ImagePoint& nearest_to_row = *std::min_element(
        points.begin(), points.end(),
        [&](const ImagePoint& a, const ImagePoint& b) { return distance_to_row_px(a) < distance_to_row_px(b); });
    object.x_px = nearest_to_row.x_px;
    object.y_px = nearest_to_row.y_px;
    for (ImagePoint& point : points) point.source = static_cast<std::uint32_t>(imaged.size());
    image_points_.insert(image_points_.end(), points.begin(), points.end());
    imaged.push_back(std::move(object));
    if (image_points_.size() > kMaxImagePoints)
      throw ImpossibleRequest(fmt::format("rows see more than {} times a star up to magnitude {:g}: lower the limit",
                                          kMaxImagePoints, request.sky->magnitude_limit),
                              "magnitude_limit");
  }
  sky = std::move(imaged);
}

SkyImage::SkyImage(const FrameRequest& request, int spread_px, std::span<const double> range_m,
                   const RenderContext& context)
    : camera_(request.camera) {
  if (!request.sky || !request.sky->any()) return;
  views_.emplace(request.camera, request.pose, request.shutter, context.stop);
  const double reach_px = 1 + spread_px;
  constexpr double kSquare_px = 1;  // the square of a point outside the image may reach into it by half
  std::vector<SkyObject> sky = views_->vary() ? sky_around_rows(request, *views_, reach_px, context.stop)
                                              : sky_around(request, *views_, kSquare_px, context.stop);
  std::erase_if(sky, [](const SkyObject& o) { return o.kind == SkyKind::sun || o.kind == SkyKind::earth; });
  locate(request, reach_px, sky, context.stop);
  find_hidden(request, *views_, hides_by_pixels(request) ? range_m : std::span<const double>(), context, sky);
  for (const SkyObject& object : sky) {
    const auto sr = object.hidden_by == HiddenBy::none ? pixel_sr(*views_, object.x_px, object.y_px) : std::nullopt;
    sources_.push_back({object.direction, sr ? object.irradiance_w_m2 / *sr : 0, sr ? object.counted_w_m2 / *sr : 0});
  }
  std::erase_if(image_points_, [&](const ImagePoint& p) { return sources_[p.source].radiance_w_m2_sr == 0; });
}

void SkyImage::add_to(std::vector<float>& radiance) const {
  for (const ImagePoint& p : image_points_)
    add_square(radiance, camera_.width, camera_.height, p.x_px, p.y_px, sources_[p.source].radiance_w_m2_sr,
               p.row == kAllRows ? std::nullopt : std::optional(p.row));
}

void SkyImage::for_points(int margin_px, const std::function<void(std::span<const LightPoint>)>& visit) const {
  constexpr std::size_t kPointsPerVisit = 4096;
  std::vector<LightPoint> points;
  for (const ImagePoint& p : image_points_) {
    const Source& source = sources_[p.source];
    const int row =
        p.row == kAllRows ? std::clamp(static_cast<int>(std::lround(p.y_px)), 0, camera_.height - 1) : p.row;
    points.push_back({p.x_px - margin_px, p.y_px - margin_px,
                      views_->of(row).moon_from_camera().transpose_times(source.direction), source.counted_w_m2_sr,
                      p.row == kAllRows ? std::nullopt : std::optional(p.row - margin_px)});
    if (points.size() == kPointsPerVisit) {
      visit(points);
      points.clear();
    }
  }
  if (!points.empty()) visit(points);
}

}  // namespace selenograph::engine
