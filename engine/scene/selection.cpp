#include "engine/scene/selection.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "dem/base/error.h"
#include "engine/camera/row_fit.h"
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
  const bool has_data = !std::isnan(ground.height_m);
  const double lowest = has_data ? ground.height_m : static_cast<double>(dem::kLowestRelief_m);
  // No camera is within a hundredth of the Moon's radius of its centre, but a position in kilometres is.
  const char* const hint =
      position_m.norm() < kMoonRadius_m / 100 ? "; are lengths in kilometres? They are metres" : "";
  constexpr double kRounding_m = 1e-6;
  if (height <= lowest + kRounding_m)
    throw ImpossibleRequest(
        fmt::format("{} is {} the terrain: {:.3f} m above the sphere{} {:.3f} m{}", subject,
                    height < lowest - kRounding_m ? "below" : "at", height,
                    has_data ? ", ground at" : "; there are no data, but no ground of the Moon is below", lowest, hint),
        member);
}

Selection select_for_view(const dem::Terrain& terrain, const View& view, const Sun* sun, const Accuracy& accuracy,
                          const StopToken& stop, const SceneBudget& budget) {
  const ViewBundle bundle{view};
  return select_for_views(terrain, {&bundle, 1}, sun, accuracy, stop, budget);
}

Selection select_for_views(const dem::Terrain& terrain, std::span<const ViewBundle> views, const Sun* sun,
                           const Accuracy& accuracy, const StopToken& stop, const SceneBudget& budget,
                           const std::vector<Ball>& receivers) {
  Accuracy targets = accuracy;
  targets.max_detail_error_px = targets.detail_aim_px();
  const auto looser = [](double target_px, double factor) { return std::max(factor * target_px, 1.0 / 16); };
  // Relax shadows first, as far as needed: their bound assumes the deepest crater, while coarser ground is visible at
  // once. If even without a shadow target the detail does not fit, relax detail. The attempt without a shadow target
  // comes before any other relaxation.
  enum class Shadows { as_requested, tried_without, relaxed } shadows = Shadows::as_requested;
  for (;;) {
    ViewSelector selector(terrain, views, targets, budget, stop, receivers);
    try {
      Selection selection = selector.select(sun);
      if (shadows == Shadows::tried_without) {
        shadows = Shadows::relaxed;
        targets.max_shadow_error_px = looser(accuracy.max_shadow_error_px, 2);
        continue;
      }
      selection.shadow_limit_px = targets.max_shadow_error_px;
      if (terrain.detailed()) selection.detail_limit_px = targets.max_detail_error_px;
      return selection;
    } catch (const TooMuchDetail&) {
      if (!selector.refined_for_shadows()) {
        shadows = Shadows::as_requested;
        targets.max_shadow_error_px = accuracy.max_shadow_error_px;
        targets.max_detail_error_px = looser(targets.max_detail_error_px, std::numbers::sqrt2);
      } else if (shadows == Shadows::as_requested) {
        shadows = Shadows::tried_without;
        targets.max_shadow_error_px = std::numeric_limits<double>::infinity();
      } else {
        targets.max_shadow_error_px = looser(targets.max_shadow_error_px, 2);
      }
    } catch (const TooMuchTerrain&) {
      if (!selector.refined_for_shadows()) throw;
      shadows = Shadows::relaxed;
      targets.max_shadow_error_px = looser(targets.max_shadow_error_px, 2);
    }
  }
}

double triangles_of(const Selection& selection) {
  double triangles = 0;
  for (const dem::BlockId& id : selection.blocks) triangles += static_cast<double>(dem::triangles_of_block(id.level));
  return triangles;
}

namespace {

// Returns the largest distance of a lens from an affine map within a tile of the z-buffer, in pixels: half the second
// difference, at nine places in the image. A vertex takes the time of a row that is off by as much.
double lens_bend_px(const View& view) {
  constexpr int kHalfTile = 16;
  const Camera& camera = view.camera();
  if (camera.rectilinear()) return 0;
  double max_bend = 0;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) {
      const double x = kHalfTile + i / 2.0 * (camera.width - 1 - 2 * kHalfTile);
      const double y = kHalfTile + j / 2.0 * (camera.height - 1 - 2 * kHalfTile);
      for (const auto& [right, down] : {std::pair{1, 0}, {0, 1}, {1, 1}, {1, -1}}) {
        const auto before = view.projection().direction(x - kHalfTile * right, y - kHalfTile * down);
        const auto middle = view.projection().direction(x, y);
        const auto after = view.projection().direction(x + kHalfTile * right, y + kHalfTile * down);
        if (!before || !middle || !after) return std::numeric_limits<double>::infinity();
        max_bend = std::max(max_bend, (*before + *after - 2 * *middle).norm() / 2);
      }
    }
  return max_bend * stretched_focal_px(view);
}

// Returns whether the z-buffer draws rows with times as ray tracing does. It gives each vertex the time of the row that
// images it and joins vertices by straight edges, so the image must move slowly: a point is then imaged once, and an
// edge, whose ends are imaged at different times, stays near its curve. The values limited here are upper bounds:
// motion by 200 pixels at the end of an image 50 degrees wide is bounded by up to 500, an edge's error over level
// ground by three times as much.
bool suits_zbuffer(const RowViews& views, const Selection& selection) {
  constexpr double kMaxMotion_px = 600;  // of the nearest ground in a corner, while all rows are exposed
  constexpr double kMaxSpeed_px = 0.6;   // the same, from row to row
  constexpr double kMaxEdgeError_px = 0.03, kMaxFitError_px = 0.004;
  constexpr double kMaxSpacing_px = 32;  // of posts: a tile's triangles reach fewer rows than kBandMargin beyond it
  const Camera& camera = views.camera();
  if (views.pushbroom() || camera.beyond_plane() || views.height() < 3) return false;
  const double focal_px = stretched_focal_px(views.reference());
  const double nearest_m = focal_px / selection.max_pixels_per_metre;
  const RowViews::Step& step = views.max_step();
  const double speed_px = focal_px * step.image_shift(nearest_m, views.reference().widest_slope());
  // From one end of an edge to the other, speeds differ by at most the step's sum times its length, and rows by at most
  // that length: the edge's middle is off a chord by a quarter of their product at most.
  const double sum =
      (step.shift_along_m + step.shift_across_m) / nearest_m + step.turn_along_rad + step.turn_across_rad;
  const double edge_error_px =
      sum * std::pow(selection.max_spacing_px, 2) / 4 + speed_px * lens_bend_px(views.reference());
  return speed_px * views.height() <= kMaxMotion_px && speed_px <= kMaxSpeed_px &&
         selection.max_spacing_px <= kMaxSpacing_px && edge_error_px <= kMaxEdgeError_px &&
         max_fit_error_px(views, nearest_m) <= kMaxFitError_px;
}

// Returns the distance of the farthest ground in view over that of the nearest, by nine rays to a sphere through the
// latter; up to that sphere's horizon.
double distance_ratio(const View& view, const Selection& selection) {
  const double nearest_m = stretched_focal_px(view) / selection.max_pixels_per_metre;
  const double eye_m = view.position().norm(), sphere_m = eye_m - nearest_m;
  if (!(nearest_m > 0 && sphere_m > kMoonRadius_m / 2)) return 1;
  const double horizon_m = std::sqrt(eye_m * eye_m - sphere_m * sphere_m);
  double farthest_m = nearest_m;
  for (const double down : {0.0, 0.5, 1.0})
    for (const double right : {0.0, 0.5, 1.0}) {
      const auto ray = view.ray(right * (view.camera().width - 1), down * (view.camera().height - 1));
      if (!ray) continue;
      const double toward_centre_m = -view.position().dot(ray->normalized());
      const double inside_m2 = sphere_m * sphere_m - eye_m * eye_m + toward_centre_m * toward_centre_m;
      const bool meets = inside_m2 > 0 && toward_centre_m > 0;
      farthest_m = std::max(farthest_m, meets ? toward_centre_m - std::sqrt(inside_m2) : horizon_m);
    }
  return farthest_m / nearest_m;
}

// Returns whether rays cast shadows faster because ground is in view from close by to the horizon: the shadow map's
// cells are of one size, so that most samples crowd in a few of them, all the more the lower the Sun is. The limit is
// where both take equally long from 2 to 1000 m above ground with the Sun at 5 to 55 degrees, in 768 and 1024 pixels.
bool crowds_shadow_map(const FrameRequest& request, const View& view, const Selection& selection) {
  constexpr double kMaxCrowding = 1e6, kLowestSun = 0.05;  // tangent of the elevation
  // The time of crowded cells grows with the fourth power of an image's side or faster, while made ground changes as
  // the camera moves, and rays need a BVH of each changed block. In small images that takes longer than the cells, on
  // a drive at 1.6 m in 512 x 512 pixels with the Sun above 8 degrees.
  constexpr double kSmallSide_px = 700, kMaxCrowdingInSmall = 4e6;
  const double sine = std::clamp(view.position().normalized().dot(request.sun.direction), 0.0, 0.999);
  const double tangent = std::max(kLowestSun, sine / std::sqrt(1 - sine * sine));
  const double side_px = std::sqrt(static_cast<double>(request.camera.width) * request.camera.height);
  const bool is_small = selection.detail_limit_px > 0 && side_px < kSmallSide_px;
  return distance_ratio(view, selection) * side_px > (is_small ? kMaxCrowdingInSmall : kMaxCrowding) * tangent;
}

}  // namespace

Visibility visibility_for(const FrameRequest& request, const RowViews& views, const Selection& selection) {
  if (!request.terrain) return Visibility::raytrace;  // nothing to draw
  if (request.shutter && (request.visibility == Visibility::raytrace || !suits_zbuffer(views, selection))) {
    if (request.visibility == Visibility::zbuffer)
      throw ImpossibleRequest(
          "these rows with times are rendered by ray tracing: the z-buffer draws those of a rolling shutter "
          "whose image moves by at most some hundred pixels, and less over coarse terrain",
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
  // Triangles per pixel at which both algorithms take equally long, measured by selenograph_benchmark
  // --benchmark_filter=dense, with the Sun at 3, 15 and 45 degrees, and at 15 with its disc. Under a low Sun triangles
  // shade more samples; for a solar disc, ray tracing casts hundreds of shadow rays.
  constexpr double kMaxWithDisc = 3000, kMaxAtLowSun = 550, kMaxAtHighSun = 850;
  constexpr double kLow = 0.1;  // sine of the Sun's elevation at which the shadow map changes its order
  const View& view = views.reference();
  if (wants_light(request) && crowds_shadow_map(request, view, selection)) return Visibility::raytrace;
  double max_triangles_per_pixel = kMaxAtHighSun;
  if (request.sun.angular_radius_deg > 0)
    max_triangles_per_pixel = kMaxWithDisc;
  else if (anchor_for(view.position(), view.middle()).normalized().dot(request.sun.direction) < kLow)
    max_triangles_per_pixel = kMaxAtLowSun;
  const double pixels = static_cast<double>(request.camera.width) * request.camera.height;
  return triangles_of(selection) > max_triangles_per_pixel * pixels ? Visibility::raytrace : Visibility::zbuffer;
}

void refuse_underground(const dem::Terrain& terrain, const RowViews& views, const StopToken& stop) {
  if (!views.vary()) return refuse_buried(terrain, views.reference().position(), "the camera", "", stop);
  for (int row = 0; row < views.height(); ++row) {
    stop.check();
    refuse_buried(terrain, views.of(row).position(), fmt::format("in row {} the camera", row), "shutter", stop);
  }
}

}  // namespace selenograph::engine
