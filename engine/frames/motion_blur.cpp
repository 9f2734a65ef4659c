#include "engine/frames/motion_blur.h"

#include <algorithm>
#include <cmath>

#include "engine/camera/row_views.h"
#include "engine/camera/view.h"
#include "engine/sensor/sensor.h"
#include "engine/visibility/objects/objects_in_frame.h"

namespace selenograph::engine {
namespace {

// Range at which translation no longer moves a point in the image.
constexpr double kFar_m = 1e9;

// Returns the range to a sphere around the origin along a unit direction; kFar_m if it is missed or left from inside.
double range_to_sphere(const Vec3& from, const Vec3& direction, double radius) {
  const double closest = -from.dot(direction);
  const double inside = radius * radius - (from + closest * direction).squared_norm();
  const double range = closest - std::sqrt(std::max(0.0, inside));
  return inside > 0 && range > 0 ? range : kFar_m;
}

// Follows points through the image from the beginning of an exposure over its middle to its end.
class PointTracker {
 public:
  PointTracker(const FrameRequest& request, double integration_time_s)
      : diagonal_px_(std::hypot(request.camera.width, request.camera.height)) {
    for (const double share : {-0.5, 0.0, 0.5})
      views_.emplace_back(request.camera, moved(request.pose, request.sensor->motion, share * integration_time_s));
  }
  const View& middle() const { return views_[1]; }
  double longest_px() const { return longest_px_; }
  void follow(const Vec3& point_m) {
    double length_px = 0;
    for (std::size_t i = 0; i < 2; ++i) {
      const auto from = views_[i].project(point_m);
      const auto to = views_[i + 1].project(point_m);
      length_px += from && to ? std::hypot(to->x - from->x, to->y - from->y) : diagonal_px_;
    }
    longest_px_ = std::max(longest_px_, std::min(length_px, diagonal_px_));
  }

 private:
  double diagonal_px_;
  double longest_px_ = 0;
  std::vector<View> views_;
};

// Returns the view of the middle row at a time of the exposure.
View middle_row_view(const FrameRequest& request, double time_s) {
  const FrameRequest at_time = during_exposure(request, time_s);
  const Shutter& shutter = *at_time.shutter;
  const double row_time_s = shutter.time_s((request.camera.height - 1) / 2.0);
  return {line_camera(request.camera, shutter), PoseTrack(request.pose, shutter).at(row_time_s)};
}

// Returns how far the image of the ground that the middle row sees moves off the row's charge, from the first stage to
// the last.
double longest_drift_px(const FrameRequest& request, double exposure_s, double ground_m) {
  const View middle = middle_row_view(request, 0);
  double longest_px = 0;
  constexpr int kPlaces = 8;
  for (const double share : {-0.5, 0.5}) {
    const View end = middle_row_view(request, share * exposure_s);
    for (int i = 0; i <= kPlaces; ++i) {
      const double x_px = (request.camera.width - 1) * static_cast<double>(i) / kPlaces;
      const auto ray = middle.ray(x_px, 0);
      if (!ray) continue;
      const Vec3 direction = ray->normalized();
      const double range =
          request.terrain ? range_to_sphere(middle.position(), direction, kMoonRadius_m + ground_m) : kFar_m;
      const auto pixel = end.project(middle.position() + range * direction);
      if (pixel) longest_px = std::max(longest_px, 2 * std::hypot(pixel->x - x_px, pixel->y));
    }
  }
  return longest_px;
}

// Height above the datum of the ground below the plan's camera, m; of the highest terrain for a camera above all of it.
double height_below_camera_m(const FramePlan& plan, const Selection& selection, const RenderContext& context) {
  const Vec3& camera_m = plan.request.pose.position_m;
  if (!plan.request.terrain || camera_m.norm() >= kMoonRadius_m + selection.highest_m) return selection.highest_m;
  const Geographic below = to_geographic(camera_m);
  const double height_m = context.terrain.height(below.lat_deg, below.lon_deg, context.stop).height_m;
  return std::isnan(height_m) ? double{dem::kLowestRelief_m} : height_m;
}

// Height above the datum of the ground in the middle of the plan's image, m.
double height_in_middle_m(const FramePlan& plan, const RenderContext& context) {
  const View middle = middle_row_view(plan.request, 0);
  const auto ray = middle.ray((plan.request.camera.width - 1) / 2.0, 0);
  if (!plan.request.terrain || !ray) return 0;
  const Vec3 direction = ray->normalized();
  const Geographic ground =
      to_geographic(middle.position() + range_to_sphere(middle.position(), direction, kMoonRadius_m) * direction);
  const double height_m = context.terrain.height(ground.lat_deg, ground.lon_deg, context.stop).height_m;
  return std::isnan(height_m) ? 0 : height_m;
}

}  // namespace

double longest_streak_px(const FrameRequest& request, double integration_time_s, double ground_m,
                         std::span<const Ball> objects) {
  if (!request.sensor->tdi.none()) return longest_drift_px(request, integration_time_s, ground_m);
  PointTracker tracker(request, integration_time_s);
  const View& middle = tracker.middle();
  const Camera& camera = request.camera;
  constexpr int kGrid = 8;
  for (int y = 0; y <= kGrid; ++y)
    for (int x = 0; x <= kGrid; ++x) {
      const auto ray = middle.ray((camera.width - 1) * static_cast<double>(x) / kGrid,
                                  (camera.height - 1) * static_cast<double>(y) / kGrid);
      if (!ray) continue;
      const Vec3 direction = ray->normalized();
      const double range =
          request.terrain ? range_to_sphere(middle.position(), direction, kMoonRadius_m + ground_m) : kFar_m;
      tracker.follow(middle.position() + range * direction);
    }
  for (const Ball& ball : objects) {
    if (!middle.may_see(ball.centre_m, ball.radius_m)) continue;
    const Vec3 toward = ball.centre_m - middle.position();
    const double distance = toward.norm();
    const double nearest = std::max(distance - ball.radius_m, 0.01 * distance);
    if (distance > 0) tracker.follow(middle.position() + toward * (nearest / distance));
  }
  return tracker.longest_px();
}

double longest_streak_px(const FramePlan& plan, double integration_time_s, const Selection& selection,
                         const RenderContext& context) {
  const double ground_m = plan.request.sensor->tdi.none() ? height_below_camera_m(plan, selection, context)
                                                          : height_in_middle_m(plan, context);
  return longest_streak_px(plan.request, integration_time_s, ground_m, balls_around(plan.request.objects));
}

FrameRequest during_exposure(FrameRequest request, double time_s) {
  if (const DelayedIntegration& tdi = request.sensor->tdi; !tdi.none()) {
    Shutter& shutter = *request.shutter;
    shutter.delay_s = time_s;
    shutter.line_px = (tdi.reversed ? 1 : -1) * time_s / shutter.line_time_s;
    return request;
  }
  request.pose = moved(request.pose, request.sensor->motion, time_s);
  return request;
}

double exposure_s(const FrameRequest& request, double integration_time_s) {
  const DelayedIntegration& tdi = request.sensor->tdi;
  return tdi.none() ? integration_time_s : tdi.stages * request.shutter->line_time_s;
}

int exposure_sample_count(const SensorModel& sensor, double longest_streak_px) {
  if (const auto& samples = sensor.tdi.none() ? sensor.motion.samples : sensor.tdi.samples) return *samples;
  const int pixels = static_cast<int>(std::ceil(std::min(longest_streak_px, double{Motion::kMaxMoments})));
  return std::clamp(pixels | 1, 1, Motion::kMaxMoments);
}

std::vector<double> exposure_sample_times_s(int count, double integration_time_s) {
  std::vector<double> times_s;
  times_s.reserve(static_cast<std::size_t>(count));
  for (int k = 0; k < count; ++k) times_s.push_back(((k + 0.5) / count - 0.5) * integration_time_s);
  return times_s;
}

std::vector<double> exposure_sample_times_s(const FramePlan& plan, double integration_time_s,
                                            const Selection& selection, const RenderContext& context) {
  if (!plan.moving) return {0};
  const double span_s = exposure_s(plan.request, integration_time_s);
  const double streak_px = longest_streak_px(plan, span_s, selection, context);
  return exposure_sample_times_s(exposure_sample_count(*plan.request.sensor, streak_px), span_s);
}

}  // namespace selenograph::engine
