// Row times: cameras whose rows are exposed one after the other. Frames and landmarks share it.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "api/requests/parts/camera_json.h"
#include "api/requests/parts/pose_json.h"
#include "engine/frame/camera.h"
#include "engine/frame/shutter.h"

namespace selenograph::api {

const Members<engine::Shutter>& shutter_members();

// A pose at a time, of which at least two give a motion; their times must rise, which check_times() reports at "poses".
inline constexpr std::size_t kMostPoses = 1000;
const Members<engine::PoseAtTime>& pose_at_time_members();
// A pose at a time, at which the Moon has turned on since the Sun's epoch.
struct TimedPose : Object<Members<engine::PoseAtTime>> {
  std::optional<engine::PoseAtTime> read(const JsonReader& in, const ReadContext& context) const;
};
void check_times(const JsonReader& in, const std::vector<engine::PoseAtTime>& poses);

// The rows of a motion and their rules: at constant `rates`, or through `poses`.
template <typename Form>
void add_motion(Members<Form>& m, const char* velocity, const char* poses) {
  const auto at_rates = [](const Form& form) { return form.poses.empty(); };
  m.add(
       "angular_rate_deg_s", [](auto& f) -> auto& { return f.rates.angular_rate_deg_s; }, kAngularRate_deg_s,
       "angular rate about the camera's own axes (opencv)")
      .written_if(at_rates);
  m.add(
       "velocity_m_s", [](auto& f) -> auto& { return f.rates.velocity_m_s; }, kVelocity_m_s, velocity)
      .written_if(at_rates);
  m.add("poses", &Form::poses, List{TimedPose{{pose_at_time_members()}}, 2, kMostPoses}, poses)
      .written_if(std::not_fn(at_rates));
  m.excludes("poses", {"velocity_m_s", "angular_rate_deg_s"}, "the poses say how the camera moves");
  m.check([](const JsonReader& in, Form& form, const ReadContext&) { check_times(in, form.poses); });
}

// The rows of a camera that a preset may give, and of a pose that a shutter may. Returns the pose's.
template <typename Query>
auto add_camera_and_pose(Members<Query>& m) {
  m.add(
      "camera", [](auto& q) -> auto& { return q.request.camera; }, Object{camera_members()},
      "projection and image size; required unless `camera_preset` has one");
  return m.add(
      "pose", [](auto& q) -> auto& { return q.request.pose; }, Object{pose_members()},
      "position and attitude of the camera; required unless `shutter.poses` is given");
}

// Requires a pose, or a shutter with poses: then the pose is the one that they give for row 0.
void check_pose(const JsonReader& in, const engine::Camera& camera, const std::optional<engine::Shutter>& shutter,
                engine::Pose& pose);
// Seconds from the sky's epoch to that of the pose in ICRF which is farthest from it, of poses at times while rows are
// exposed; 0: none is in ICRF. `utc`: the epoch of poses that have none. Of a request without faults.
double icrf_lag_s(const JsonReader& in, const engine::Camera& camera, const std::optional<engine::Shutter>& shutter,
                  const std::string& utc, const std::string& sky_utc);
// That requirement as a schema condition.
OrderedJson pose_condition(const Limits& limits);

}  // namespace selenograph::api
