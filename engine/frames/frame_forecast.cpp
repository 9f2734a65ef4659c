#include "engine/frames/frame_forecast.h"

#include <optional>

#include "engine/frame/needs.h"
#include "engine/frames/frame_drawing.h"
#include "engine/frames/frame_plan.h"
#include "engine/frames/frame_selection.h"
#include "engine/frames/motion_blur.h"
#include "engine/indirect/terrain_light.h"
#include "engine/visibility/objects/objects_in_frame.h"

namespace selenograph::engine {
namespace {

// Returns the longest exposure that automatic exposure may choose, or the fixed integration time.
double longest_exposure_s(const SensorModel& sensor) {
  return sensor.exposure.target_fill > 0 ? sensor.exposure.longest_s : sensor.detector.integration_time_s;
}

}  // namespace

std::vector<double> shadow_limits_px(const FrameRequest& request, const RenderContext& context) {
  std::optional<Sensor> sensor = make_sensor(request, context.stop);
  const FramePlan plan = plan_frame(request, sensor);
  FrameRequest drawn = plan.request;
  const auto select_at = [&](const Pose& pose) {
    drawn.pose = pose;
    const RowViews views(drawn.camera, drawn.pose, drawn.shutter, context.stop);
    return select_blocks(drawn, views, drawn.accuracy, context);
  };
  const Selection middle = select_at(request.pose);
  std::vector<double> limits{middle.shadow_limit_px};
  if (!plan.moving) return limits;
  for (const double time_s : exposure_sample_times_s(plan, longest_exposure_s(*request.sensor), middle, context))
    if (time_s != 0 || sensor->wants_samples())
      limits.push_back(select_at(moved(request.pose, request.sensor->motion, time_s)).shadow_limit_px);
  return limits;
}

std::function<bool()> prepare_frame(const FrameRequest& request, const RenderContext& context) {
  std::optional<Sensor> sensor = make_sensor(request, context.stop);
  const FramePlan plan = plan_frame(request, sensor);
  const RowViews views(plan.request.camera, plan.request.pose, plan.request.shutter, context.stop);
  const Selection selection = select_blocks(plan.request, views, plan.request.accuracy, context);
  const SceneContent content = content_of(plan.request, views, selection, context.terrain);
  const auto scene = context.cache.scene(content, context.stop, RenderCache::Purpose::preparation);
  if (wants_indirect(plan.request))
    TerrainLight(plan.request, {views, scene->mesh, balls_around(plan.request.objects), {}}, std::nullopt,
                 context.terrain, plan.radiance.direct_w_m2, context.cache.light_tiles(), context.stop);
  return context.cache.use_of(content);
}

}  // namespace selenograph::engine
