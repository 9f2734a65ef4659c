#include "engine/frames/frame_report.h"

#include <algorithm>
#include <cmath>

#include "engine/visibility/image/frame_sources.h"

namespace selenograph::engine {
namespace {

void report_scene(const FrameMoment& moment, const Drawn& drawn, FrameReport& out) {
  const Selection& selection = moment.selection();
  out.lod_error_px = selection.error_px, out.lod_error_m = selection.error_m;
  out.expected_error_px = selection.expected_error_px, out.expected_error_m = selection.expected_error_m;
  out.detail_error_px = selection.detail_error_px, out.detail_limit_px = selection.detail_limit_px;
  out.shadow_error_px = selection.shadow_error_px;
  out.shadow_limits_px.insert(out.shadow_limits_px.begin(), selection.shadow_limit_px);
  out.min_post_spacing_m = selection.min_spacing_m, out.max_post_spacing_m = selection.max_spacing_m;
  out.rocks = moment.rocks().rocks.size(), out.least_rock_px = moment.rocks().least_px;
  out.triangles = drawn.triangles, out.scene_bytes = drawn.scene_bytes, out.ground_view = drawn.ground_view;
  out.visibility = moment.visibility();
}

void report_pixels(const PixelCounts& counts, double pixels, FrameReport& out) {
  out.hit_fraction = static_cast<double>(counts.hit) / pixels;
  out.object_fraction = static_cast<double>(counts.on_object) / pixels;
  out.rock_fraction = static_cast<double>(counts.on_rock) / pixels;
  out.missing_fraction = static_cast<double>(counts.missing) / pixels;
  out.filled_fraction = static_cast<double>(counts.filled) / pixels;
  out.blended_fraction = static_cast<double>(counts.blended) / pixels;
}

double azimuth_deg(const EastNorthUp& local, const Vec3& direction) {
  const double degrees = std::atan2(direction.dot(local.east), direction.dot(local.north)) * kDegreesPerRadian;
  return degrees < 0 ? degrees + 360 : degrees;
}

// The angle across a pixel in the middle of the boresight.
double pixel_rad(const View& view) {
  const Camera& camera = view.camera();
  const auto left = view.ray(camera.cx - 0.5, camera.cy), right = view.ray(camera.cx + 0.5, camera.cy);
  return left && right ? angle_between(*left, *right) : 0;
}

// The phase angle is that between the ray's reverse and the Sun, wherever the ray ends. It is smallest towards the
// point opposite to the Sun, if that is in view.
std::optional<std::array<double, 2>> phases_deg(const View& view, const Vec3& sun) {
  constexpr int kAlong = 8;
  const Camera& camera = view.camera();
  std::optional<std::array<double, 2>> range;
  for (int j = 0; j <= kAlong; ++j)
    for (int i = 0; i <= kAlong; ++i) {
      const auto ray = view.ray(i * (camera.width - 1.0) / kAlong, j * (camera.height - 1.0) / kAlong);
      if (!ray) continue;
      const double phase_deg = angle_between(-*ray, sun) * kDegreesPerRadian;
      if (!range) range = {phase_deg, phase_deg};
      (*range)[0] = std::min((*range)[0], phase_deg), (*range)[1] = std::max((*range)[1], phase_deg);
    }
  const auto opposition = view.project(view.position() - kMoonRadius_m * sun);
  if (range && opposition && opposition->x >= -0.5 && opposition->x <= camera.width - 0.5 && opposition->y >= -0.5 &&
      opposition->y <= camera.height - 0.5)
    (*range)[0] = 0;
  return range;
}

void report_view(const Drawn& drawn, const View& view, const Vec3& sun, const dem::Catalogue& catalogue,
                 ViewReport& out) {
  const Vec3 boresight = view.moon_from_camera().col(2), up = -view.moon_from_camera().col(1);
  if (sun.norm() > 0) out.phase_deg = phases_deg(view, sun);
  out.off_nadir_deg = angle_between(boresight, -view.position()) * kDegreesPerRadian;
  for (std::size_t i = 0; i < out.corners.size(); ++i)
    if (const auto& met = drawn.met[ViewMarks::kFirstCorner + i]) out.corners[i] = to_geographic(met->position_m);
  const auto& met = drawn.met[ViewMarks::kBoresight];
  if (!met) return;
  out.boresight = to_geographic(met->position_m);
  const EastNorthUp local = local_axes(met->position_m);
  // Where the ground is that is a little farther up in the image.
  const double falls = met->direction.dot(local.up);
  if (falls != 0) out.up_azimuth_deg = azimuth_deg(local, up - up.dot(local.up) / falls * met->direction);
  out.sun_azimuth_deg = azimuth_deg(local, sun);
  out.sun_elevation_deg = std::asin(std::clamp(sun.dot(local.up), -1.0, 1.0)) * kDegreesPerRadian;
  const double pixel_m = pixel_rad(view) * (met->position_m - view.position()).norm();
  if (met->source != dem::kNoSource && pixel_m > 0)
    out.post_px = catalogue.rasters()[met->source].post_spacing_m / pixel_m;
}

}  // namespace

void report_frame(const FramePlan& plan, const FrameMoment& moment, const Drawn& drawn, const dem::Terrain& terrain,
                  Frame& frame) {
  const FrameRequest& request = plan.request;
  FrameReport& out = frame.report;
  report_scene(moment, drawn, out);
  report_pixels(drawn.counts, drawn.pixels, out);
  report_view(drawn, moment.views().reference(), request.sun.direction, terrain.catalogue(), out.view);
  // The frame's own list of sources, in the catalogue's order; `source` holds indices into it.
  for (const dem::SourceIndex raster : drawn.sources)
    out.sources.push_back(source_tile(terrain.catalogue().rasters()[raster]));
  out.radiance = plan.radiance, out.emits_elsewhere = plan.emits_elsewhere;
  if (request.products & kRock) frame.rocks = moment.rocks().rocks;
  if (request.terrain) out.warnings = terrain.warnings_about(moment.selection().replaced);
}

}  // namespace selenograph::engine
