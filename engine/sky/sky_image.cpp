#include "engine/sky/sky_image.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "dem/base/error.h"
#include "engine/frame/needs.h"

namespace selenograph::engine {

// Of all rows that are within `reach_px` of what they see of it; of one place for all of them once.
std::vector<SkyImage::Place> SkyImage::places_of(const SkyObject& object, double reach_px) const {
  std::vector<Place> places;
  for (const ViewBundle& bundle : views_->bundles()) {
    const Vec3 far_m = bundle.view.position() + kStarDistance_m * object.direction;
    if (!bundle.may_see(far_m, reach_px / bundle.view.least_pixels_per_metre(far_m, 0))) continue;
    for (int row = bundle.first_row; row < bundle.past_last_row; ++row) {
      const View& view = views_->of(row);
      const auto pixel = view.project(view.position() + kStarDistance_m * object.direction);
      const double below = pixel ? pixel->y - views_->line(row) : reach_px;
      if (std::abs(below) < reach_px && pixel->x > -reach_px && pixel->x < camera_.width - 1 + reach_px)
        places.push_back({pixel->x, row + below, row, 0});
    }
  }
  constexpr double kSame_px = 1e-6;
  const auto at_first = [&](const Place& p) {
    return std::abs(p.x_px - places[0].x_px) < kSame_px && std::abs(p.y_px - places[0].y_px) < kSame_px;
  };
  if (places.empty() || !std::all_of(places.begin(), places.end(), at_first)) return places;
  const int first = std::max(0, static_cast<int>(std::floor(places[0].y_px - reach_px)) + 1),
            last = std::min(views_->height(), static_cast<int>(std::ceil(places[0].y_px + reach_px))) - 1;
  if (places.size() != static_cast<std::size_t>(last - first + 1)) return places;
  return {{places[0].x_px, places[0].y_px, kAllRows, 0}};
}

// Leaves of the sky what is seen, each where it is nearest to its row.
void SkyImage::find(const FrameRequest& request, double reach_px, std::vector<SkyObject>& sky, const StopToken& stop) {
  constexpr std::size_t kMostPlaces = 64 * kMostStars;
  std::vector<SkyObject> seen;
  for (SkyObject& object : sky) {
    stop.check();
    std::vector<Place> places;
    if (views_->vary())
      places = places_of(object, reach_px);
    else if (object.x_px > -1 && object.x_px < camera_.width && object.y_px > -1 && object.y_px < camera_.height)
      places = {{object.x_px, object.y_px, kAllRows, 0}};
    if (places.empty()) continue;
    const auto off_row = [](const Place& p) { return p.row == kAllRows ? 0 : std::abs(p.y_px - p.row); };
    const Place& best = *std::min_element(places.begin(), places.end(),
                                          [&](const Place& a, const Place& b) { return off_row(a) < off_row(b); });
    object.x_px = best.x_px, object.y_px = best.y_px;
    for (Place& place : places) place.source = static_cast<std::uint32_t>(seen.size());
    places_.insert(places_.end(), places.begin(), places.end());
    seen.push_back(std::move(object));
    if (places_.size() > kMostPlaces)
      throw ImpossibleRequest(fmt::format("rows see more than {} times a star up to magnitude {:g}: lower the limit",
                                          kMostPlaces, request.sky->magnitude_limit),
                              "magnitude_limit");
  }
  sky = std::move(seen);
}

SkyImage::SkyImage(const FrameRequest& request, int spread_px, std::span<const double> range_m,
                   const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop)
    : camera_(request.camera) {
  if (!request.sky || !request.sky->any()) return;
  views_.emplace(request.camera, request.pose, request.shutter, stop);
  const double reach_px = 1 + spread_px;
  constexpr double kSquare_px = 1;  // a point beside the image leaves half of its square in it
  std::vector<SkyObject> sky = views_->vary() ? sky_around_rows(request, *views_, reach_px, stop)
                                              : sky_around(request, *views_, kSquare_px, stop);
  std::erase_if(sky, [](const SkyObject& o) { return o.kind == SkyKind::sun || o.kind == SkyKind::earth; });
  find(request, reach_px, sky, stop);
  find_hidden(request, *views_, hides_by_pixels(request) ? range_m : std::span<const double>(), terrain, kept, stop,
              sky);
  for (const SkyObject& object : sky) {
    const auto sr = object.hidden_by == HiddenBy::none ? pixel_sr(*views_, object.x_px, object.y_px) : std::nullopt;
    sources_.push_back({object.direction, sr ? object.irradiance_w_m2 / *sr : 0, sr ? object.counted_w_m2 / *sr : 0});
  }
  std::erase_if(places_, [&](const Place& p) { return sources_[p.source].radiance_w_m2_sr == 0; });
}

void SkyImage::add_to(std::vector<float>& radiance) const {
  for (const Place& p : places_)
    add_square(radiance, camera_.width, camera_.height, p.x_px, p.y_px, sources_[p.source].radiance_w_m2_sr,
               p.row == kAllRows ? std::nullopt : std::optional(p.row));
}

void SkyImage::for_points(int margin_px, const std::function<void(std::span<const LightPoint>)>& visit) const {
  constexpr std::size_t kAtOnce = 4096;
  std::vector<LightPoint> points;
  for (const Place& p : places_) {
    const Source& source = sources_[p.source];
    const int row =
        p.row == kAllRows ? std::clamp(static_cast<int>(std::lround(p.y_px)), 0, camera_.height - 1) : p.row;
    points.push_back({p.x_px - margin_px, p.y_px - margin_px,
                      views_->of(row).moon_from_camera().transpose() * source.direction, source.counted_w_m2_sr,
                      p.row == kAllRows ? std::nullopt : std::optional(p.row - margin_px)});
    if (points.size() == kAtOnce) visit(points), points.clear();
  }
  if (!points.empty()) visit(points);
}

}  // namespace selenograph::engine
