#include "engine/frames/render_frame.h"

#include "engine/frame/needs.h"
#include "engine/frames/crater_rims.h"
#include "engine/frames/frame_exposure.h"
#include "engine/frames/frame_moment.h"
#include "engine/frames/frame_plan.h"
#include "engine/frames/frame_report.h"
#include "engine/frames/motion_blur.h"
#include "engine/support/stopwatch.h"

namespace selenograph::engine {
namespace {

RowViews views_of(const FrameRequest& request, const StopToken& stop) {
  return {request.camera, request.pose, request.shutter, stop};
}

void list_craters(const FrameRequest& asked, const Selection& selection, const dem::Terrain& terrain, RenderCache& kept,
                  const StopToken& stop, Frame& frame) {
  Stopwatch watch;
  frame.report.craters =
      crater_rims(asked, selection, frame.products.range, terrain, kept.roughness(terrain, stop), stop);
  frame.times.craters_ms = watch.lap_ms();
}

// Exposes the drawn frame. The exposure's other moments have stages of their own, which are not counted twice.
void expose(FrameExposure& exposure, Frame& frame) {
  Stopwatch watch;
  const double drawn_ms = frame.times.sum_ms();
  exposure.draw_moments(frame);
  exposure.make_image(frame);
  frame.times.sensor_ms = watch.lap_ms() - (frame.times.sum_ms() - drawn_ms);
}

// Where the frame decides, what it may decide at most.
double longest_exposure_s(const SensorModel& sensor) {
  return sensor.exposure.target_fill > 0 ? sensor.exposure.longest_s : sensor.detector.integration_time_s;
}

}  // namespace

Frame render_frame(const FrameRequest& asked, const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop) {
  Frame frame;
  // Plan: what is drawn, what the sensor counts, which terms radiance has.
  Stopwatch watch;
  FramePlan plan(asked, stop);
  const double plan_ms = watch.lap_ms();
  // Select: which blocks of the terrain, how fine; what may shade them; rocks and objects.
  FrameMoment middle(plan.request, terrain, kept, stop);
  // Scene: the blocks as one mesh, with what the visibility algorithm needs of it.
  middle.make_scene(plan.draws(middle.selection(), terrain, stop));
  // Draw: visible points, light, radiance and products; then the other moments of the exposure, in the same way.
  FrameExposure exposure(plan, middle, terrain, kept, stop);
  const Drawn drawn = middle.draw(plan.margin_px(), exposure.each_of_middle(), frame.products);
  frame.times = middle.times();
  // Expose: from radiance to digital numbers.
  expose(exposure, frame);
  frame.times.sensor_ms += plan_ms;
  // Craters: where those of the detail are in the image.
  if (wants_craters(asked)) list_craters(asked, middle.selection(), terrain, kept, stop, frame);
  if (wants_ranges(asked)) thin(frame.products, asked);
  // Report: what is known of the frame besides its pixels.
  report_frame(plan, middle, drawn, terrain, frame);
  return frame;
}

std::vector<double> shadow_limits_px(const FrameRequest& asked, const dem::Terrain& terrain, const RenderCache& kept,
                                     const StopToken& stop) {
  const FramePlan plan(asked, stop);
  FrameRequest request = plan.request;
  const auto selected = [&](const Pose& pose) {
    request.pose = pose;
    return select_blocks(request, views_of(request, stop), request.accuracy, terrain, kept, stop);
  };
  const Selection middle = selected(asked.pose);
  std::vector<double> limits{middle.shadow_limit_px};
  if (!plan.moving()) return limits;
  const double exposure_s = longest_exposure_s(*asked.sensor);
  for (const double moment : moments_of(plan.moments(exposure_s, middle, terrain, stop), exposure_s))
    if (moment != 0) limits.push_back(selected(moved(asked.pose, asked.sensor->motion, moment)).shadow_limit_px);
  return limits;
}

std::function<bool()> prepare_frame(const FrameRequest& asked, const dem::Terrain& terrain, RenderCache& kept,
                                    const StopToken& stop) {
  const FramePlan plan(asked, stop);
  const RowViews views = views_of(plan.request, stop);
  const Selection selection = select_blocks(plan.request, views, plan.request.accuracy, terrain, kept, stop);
  const SceneContent content = content_of(plan.request, views, selection, terrain);
  const auto scene = kept.scene(content, stop, RenderCache::Purpose::preparation);
  if (wants_indirect(plan.request))
    TerrainLight(plan.request, {views, scene->mesh, balls_around(plan.request.objects), {}}, std::nullopt, terrain,
                 plan.radiance.direct_w_m2, kept.light_tiles(), stop);
  return kept.use_of(content);
}

}  // namespace selenograph::engine
