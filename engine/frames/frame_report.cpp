#include "engine/frames/frame_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>

#include "engine/visibility/image/frame_sources.h"

namespace selenograph::engine {
namespace {

void report_selection(const FrameSelection& selected, FrameReport& report) {
  const Selection& terrain = selected.terrain;
  report.lod_error_px = terrain.error_px;
  report.lod_error_m = terrain.error_m;
  report.expected_error_px = terrain.expected_error_px;
  report.expected_error_m = terrain.expected_error_m;
  report.detail_error_px = terrain.detail_error_px;
  report.detail_limit_px = terrain.detail_limit_px;
  report.shadow_error_px = terrain.shadow_error_px;
  report.shadow_limits_px.insert(report.shadow_limits_px.begin(), terrain.shadow_limit_px);
  report.min_post_spacing_m = terrain.min_spacing_m;
  report.max_post_spacing_m = terrain.max_spacing_m;
  report.rocks = selected.rocks.rocks.size();
  report.least_rock_px = selected.rocks.least_px;
  report.visibility = selected.content.visibility;
}

void report_drawing(const FrameDrawing& drawing, FrameReport& report) {
  report.triangles = drawing.triangles;
  report.scene_bytes = drawing.scene_bytes;
  report.ground_view = drawing.ground_view;
  const auto share = [&](std::uint64_t pixels) { return static_cast<double>(pixels) / drawing.pixels; };
  report.hit_fraction = share(drawing.counts.hit);
  report.object_fraction = share(drawing.counts.on_object);
  report.rock_fraction = share(drawing.counts.on_rock);
  report.missing_fraction = share(drawing.counts.missing);
  report.filled_fraction = share(drawing.counts.filled);
  report.blended_fraction = share(drawing.counts.blended);
}

double azimuth_deg(const EastNorthUp& local, const Vec3& direction) {
  const double degrees = std::atan2(direction.dot(local.east), direction.dot(local.north)) * kDegreesPerRadian;
  const double positive = degrees + 360;  // rounds to 360 for an azimuth just below 0
  return degrees < 0 && positive < 360 ? positive : std::max(degrees, 0.0);
}

// Returns the angle that the pixel at the principal point spans horizontally.
double pixel_rad(const View& view) {
  const Camera& camera = view.camera();
  const auto left = view.ray(camera.cx - 0.5, camera.cy);
  const auto right = view.ray(camera.cx + 0.5, camera.cy);
  return left && right ? angle_between(*left, *right) : 0;
}

bool is_in_image(const Camera& camera, const PixelXY& pixel) {
  return pixel.x >= -0.5 && pixel.x <= camera.width - 0.5 && pixel.y >= -0.5 && pixel.y <= camera.height - 0.5;
}

// Returns the smallest and the largest phase angle over the image, sampled on a grid. The phase angle is that between
// the ray's reverse and the Sun, wherever the ray ends. It is 0 toward the point opposite to the Sun, if that is in
// view.
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
      (*range)[0] = std::min((*range)[0], phase_deg);
      (*range)[1] = std::max((*range)[1], phase_deg);
    }
  const auto opposition = view.project(view.position() - kMoonRadius_m * sun);
  if (range && opposition && is_in_image(camera, *opposition)) (*range)[0] = 0;
  return range;
}

void report_boresight(const ViewMarks::MarkHit& mark, const View& view, const Vec3& sun,
                      const dem::Catalogue& catalogue, ViewReport& report) {
  report.boresight = to_geographic(mark.position_m);
  const EastNorthUp local = local_axes(mark.position_m);
  // Slide the image's up direction along the line of sight, which does not move it in the image, until it is
  // horizontal.
  const Vec3 up = -view.moon_from_camera().col(1);
  const double climb = mark.direction.dot(local.up);
  if (climb != 0) report.up_azimuth_deg = azimuth_deg(local, up - up.dot(local.up) / climb * mark.direction);
  report.sun_azimuth_deg = azimuth_deg(local, sun);
  report.sun_elevation_deg = std::asin(std::clamp(sun.dot(local.up), -1.0, 1.0)) * kDegreesPerRadian;
  const double pixel_m = pixel_rad(view) * (mark.position_m - view.position()).norm();
  if (mark.source != dem::kNoSource && pixel_m > 0)
    report.post_px = catalogue.rasters()[mark.source].post_spacing_m / pixel_m;
}

void report_view(const FrameDrawing& drawing, const View& view, const Vec3& sun, const dem::Catalogue& catalogue,
                 ViewReport& report) {
  if (sun.norm() > 0) report.phase_deg = phases_deg(view, sun);
  const Vec3 boresight = view.moon_from_camera().col(2);
  report.off_nadir_deg = angle_between(boresight, -view.position()) * kDegreesPerRadian;
  for (std::size_t i = 0; i < report.corners.size(); ++i)
    if (const auto& mark = drawing.marks[ViewMarks::kFirstCorner + i])
      report.corners[i] = to_geographic(mark->position_m);
  if (const auto& mark = drawing.marks[ViewMarks::kBoresight]) report_boresight(*mark, view, sun, catalogue, report);
}

}  // namespace

FrameReport report_frame(const FramePlan& plan, const FrameSelection& selected, const FrameDrawing& drawing,
                         const dem::Terrain& terrain, FrameReport exposed) {
  FrameReport report = std::move(exposed);
  const dem::Catalogue& catalogue = terrain.catalogue();
  report_selection(selected, report);
  report_drawing(drawing, report);
  report_view(drawing, selected.views.reference(), plan.request.sun.direction, catalogue, report.view);
  // The frame's own list of sources is in the catalogue's order; `source` holds indices into it.
  for (const dem::SourceIndex raster : drawing.sources)
    report.sources.push_back(source_tile(catalogue.rasters()[raster]));
  report.radiance = plan.radiance;
  report.emits_elsewhere = plan.emits_elsewhere;
  if (plan.request.terrain) report.warnings = dem::warnings_about(terrain.catalogue(), selected.terrain.replaced);
  return report;
}

}  // namespace selenograph::engine
