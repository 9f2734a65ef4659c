// Makes a frame: plan, select, scene, draw, expose, report.
//
//   FrameRequest --plan_frame--> FramePlan
//                                   |        once for the middle, and again for each sample of a moving exposure
//                                   v        +------------------------------------------------------------+
//                                            | select_frame ----> make_scene ----------> draw_frame       |
//                                            |  blocks, rocks      one mesh, light        points, light,  |
//                                            |  and objects        from terrain           radiance        |
//                                            +------------------------------------------------------------+
//                                   |        eqs. (2), (3)                               eq. (1)
//                                   v
//                             expose_frame (sky, optics, detector: eqs. 8, 9) --> report_frame --> Frame
//
// Equations are those of the SENSOR++ paper (Paproth et al.).
#include "engine/frames/render_frame.h"

#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "engine/frame/needs.h"
#include "engine/frames/crater_rims.h"
#include "engine/frames/frame_drawing.h"
#include "engine/frames/frame_exposure.h"
#include "engine/frames/frame_plan.h"
#include "engine/frames/frame_report.h"
#include "engine/frames/frame_selection.h"
#include "engine/frames/motion_blur.h"
#include "engine/support/stopwatch.h"

namespace selenograph::engine {
namespace {

// Returns the number of scenes like the middle's that the frame draws, for the estimate of its work. Where the frame
// chooses its exposure time and the number of samples, it counts as one sample: its streaks are not known yet.
std::size_t scenes_to_draw(const FramePlan& plan, const std::optional<Sensor>& sensor, const Selection& selection,
                           const RenderContext& context) {
  const double exposure_s = sensor ? sensor->integration_time_s() : 0;
  return exposure_sample_times_s(plan, exposure_s, selection, context).size() + (plan.photon_request ? 1 : 0);
}

CraterRims find_craters(const FrameRequest& request, const Selection& selection, std::span<const double> range_m,
                        const RenderContext& context) {
  return crater_rims(request, selection, range_m, context.terrain,
                     context.cache.roughness(context.terrain, context.stop), context.stop);
}

}  // namespace

Frame render_frame(const FrameRequest& request, const RenderContext& context) {
  Stopwatch watch;
  // Plan: pixels with the sensor's margin, the band in which photons are counted, the terms of radiance. The sensor
  // gathers light from here to the exposure; nothing else in this function has state.
  std::optional<Sensor> sensor = make_sensor(request, context.stop);
  const FramePlan plan = plan_frame(request, sensor);
  const double plan_ms = watch.lap_ms();

  // All ground truth belongs to the middle of the exposure.
  // Select: the blocks of terrain that are in view or may shade it, and their levels of detail; rocks; objects.
  const FrameSelection selected = select_frame(plan.request, context);

  // Scene: the blocks as one mesh without gaps, with an acceleration structure and light from terrain. A frame that
  // draws too many of them for its deadline is refused.
  const std::size_t draws = scenes_to_draw(plan, sensor, selected.terrain, context);
  FrameScene scene = make_scene(plan.request, selected, draws, context);

  // Draw: for each pixel the visible point, its sunlight, its radiance (eq. 1), its products.
  const std::shared_ptr<const PixelRays> pixel_rays = scene.pixel_rays;
  const ExposureMiddle middle{selected, *pixel_rays};
  FrameDrawing drawing = draw_frame(plan.request, selected, std::move(scene), plan.margin_px,
                                    samples_for_sensor(plan, middle, sensor, context.stop), context);

  // Expose: the other samples of the exposure, the sky, optics and detector (eq. 8); from radiance to digital numbers.
  ExposedFrame exposed = expose_frame(plan, middle, std::move(drawing.products), sensor, context);

  // Report: what is known of the frame besides its pixels.
  Frame frame;
  frame.report = report_frame(plan, selected, drawing, context.terrain, std::move(exposed.report));
  frame.products = std::move(exposed.products);
  frame.times = selected.times;
  frame.times += drawing.times;
  frame.times += exposed.times;
  frame.times.sensor_ms += plan_ms;
  if (plan.request.products & kRock) frame.rocks = selected.rocks.rocks;
  if (wants_craters(request)) {
    Stopwatch crater_watch;
    frame.report.craters = find_craters(request, selected.terrain, frame.products.range, context);
    frame.times.craters_ms = crater_watch.lap_ms();
  }
  // Drop the ranges that only craters and the sky needed.
  if (wants_ranges(request)) keep_requested(frame.products, request);
  return frame;
}

}  // namespace selenograph::engine
