#include "engine/scene/selection.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "dem/base/error.h"
#include "engine/frame/needs.h"
#include "engine/scene/anchor.h"
#include "engine/scene/view_selector.h"

namespace selenograph::engine {

void refuse_buried(const dem::Terrain& terrain, const Vec3& position_m, const std::string& subject,
                   const std::string& member, const StopToken& stop) {
  const double height = position_m.norm() - kMoonRadius_m;
  if (height > static_cast<double>(dem::kHighestRelief_m)) return;
  const Geographic g = to_geographic(position_m);
  const dem::HeightAnswer ground = terrain.height(g.lat_deg, g.lon_deg, stop);
  const bool known = !std::isnan(ground.height_m);
  const double lowest = known ? ground.height_m : static_cast<double>(dem::kLowestRelief_m);
  // No camera is within a hundredth of the Moon's radius of its centre, but positions in kilometres are.
  const char* const hint =
      position_m.norm() < kMoonRadius_m / 100 ? "; are lengths in kilometres? They are metres" : "";
  if (height <= lowest)
    throw ImpossibleRequest(
        fmt::format("{} is below the terrain: {:.3f} m above the sphere{} {:.3f} m{}", subject, height,
                    known ? ", ground at" : "; there are no data, but no ground of the Moon is below", lowest, hint),
        member);
}

Selection select_for_view(const dem::Terrain& terrain, const View& view, const Sun* sun, const Accuracy& accuracy,
                          const StopToken& stop, const SceneRoom& room) {
  const ViewBundle one{view};
  return select_for_views(terrain, {&one, 1}, sun, accuracy, stop, room);
}

Selection select_for_views(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Sun* sun,
                           const Accuracy& accuracy, const StopToken& stop, const SceneRoom& room,
                           const std::vector<Ball>& receivers) {
  Accuracy asked = accuracy;
  asked.max_detail_error_px = asked.detail_aim_px();
  const auto looser = [](double target_px, double by) { return std::max(by * target_px, 1.0 / 16); };
  // Shadows give way first, as far as they must: their bound is that of the deepest crater, while coarser ground is
  // seen at once. Where no shadow target is loose enough, which is tried before others are, detail gives way.
  enum class Shadows { as_asked, tried_without, relaxed } shadows = Shadows::as_asked;
  for (;;) {
    ViewSelector selector(terrain, views, asked, room, stop, receivers);
    try {
      Selection selection = selector.select(sun);
      if (shadows == Shadows::tried_without) {
        shadows = Shadows::relaxed;
        asked.max_shadow_error_px = looser(accuracy.max_shadow_error_px, 2);
        continue;
      }
      selection.shadow_limit_px = asked.max_shadow_error_px;
      if (terrain.detail()) selection.detail_limit_px = asked.max_detail_error_px;
      return selection;
    } catch (const TooMuchDetail&) {
      if (!selector.refined_for_shadows()) {
        shadows = Shadows::as_asked;
        asked.max_shadow_error_px = accuracy.max_shadow_error_px;
        asked.max_detail_error_px = looser(asked.max_detail_error_px, std::numbers::sqrt2);
      } else if (shadows == Shadows::as_asked) {
        shadows = Shadows::tried_without;
        asked.max_shadow_error_px = std::numeric_limits<double>::infinity();
      } else {
        asked.max_shadow_error_px = looser(asked.max_shadow_error_px, 2);
      }
    } catch (const TooMuchTerrain&) {
      if (!selector.refined_for_shadows()) throw;
      shadows = Shadows::relaxed;
      asked.max_shadow_error_px = looser(asked.max_shadow_error_px, 2);
    }
  }
}

double triangles_of(const Selection& selection) {
  double triangles = 0;
  for (const dem::BlockId& id : selection.blocks) triangles += static_cast<double>(dem::triangles_of_block(id.level));
  return triangles;
}

Visibility visibility_for(const FrameRequest& request, const RowViews& views, const Selection& selection) {
  if (!request.terrain) return Visibility::raytrace;  // nothing to draw
  if (request.shutter) {
    if (request.visibility == Visibility::zbuffer)
      throw ImpossibleRequest("rows with times are rendered by ray tracing: the z-buffer draws all rows from one place",
                              "visibility");
    return Visibility::raytrace;
  }
  if (request.camera.beyond_plane()) {
    if (request.visibility == Visibility::zbuffer)
      throw ImpossibleRequest("a fisheye is rendered by ray tracing: the z-buffer draws onto a plane", "visibility");
    return Visibility::raytrace;
  }
  if (wants_flow(request)) {
    if (request.visibility == Visibility::zbuffer)
      throw ImpossibleRequest("flow needs ray tracing: the z-buffer sees from one place", "visibility");
    return Visibility::raytrace;
  }
  if (request.visibility != Visibility::automatic) return request.visibility;
  // Triangles per pixel where both take equally long, measured by selenograph_benchmark --benchmark_filter=dense, whose
  // Suns are at 3, 15 and 45 degrees and at 15 with its disc. Under a low Sun triangles shade more samples; of the
  // Sun's disc rays ask for hundreds of directions.
  constexpr double kMostWithDisc = 3000, kMostAtLowSun = 550, kMost = 850;
  constexpr double kLow = 0.1;  // sine of the Sun's elevation, as where the shadow map's order changes
  const View& view = views.reference();
  double most = kMost;
  if (request.sun.angular_radius_deg > 0)
    most = kMostWithDisc;
  else if (anchor_for(view.position(), view.middle()).normalized().dot(request.sun.direction) < kLow)
    most = kMostAtLowSun;
  const double pixels = static_cast<double>(request.camera.width) * request.camera.height;
  return triangles_of(selection) > most * pixels ? Visibility::raytrace : Visibility::zbuffer;
}

void refuse_underground(const dem::Terrain& terrain, const RowViews& views, const StopToken& stop) {
  if (!views.vary()) return refuse_buried(terrain, views.reference().position(), "the camera", "", stop);
  for (int row = 0; row < views.height(); ++row) {
    stop.check();
    refuse_buried(terrain, views.of(row).position(), fmt::format("in row {} the camera", row), "shutter", stop);
  }
}

}  // namespace selenograph::engine
