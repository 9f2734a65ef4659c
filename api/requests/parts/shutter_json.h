// "shutter": cameras whose rows are exposed one after the other, from moving poses. Frames, landmarks and the sky share
// it:
//
//   row 0  exposed at 0                     pose of row 0
//   row 1  exposed at     line_time_s          pose of row 1
//   row y  exposed at y * line_time_s             pose of row y
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "api/requests/parts/camera_json.h"
#include "api/requests/parts/pose_json.h"
#include "engine/frame/camera.h"
#include "engine/frame/request.h"
#include "engine/frame/shutter.h"

namespace selenograph::api {

const Members<engine::Shutter>& shutter_members();

inline constexpr std::size_t kMaxPoses = 1000;  // of a motion; at least two are required
const Members<engine::PoseAtTime>& pose_at_time_members();
// Kind of a pose at a time. A pose in ICRF without an epoch is converted at the Sun's epoch plus its time_s, since the
// Moon rotates meanwhile.
struct TimedPose : Object<Members<engine::PoseAtTime>> {
  std::optional<engine::PoseAtTime> read(const JsonReader& in, const ReadContext& context) const;
};
// Reports poses whose times do not rise, at the member "poses".
void check_times(const JsonReader& in, const std::vector<engine::PoseAtTime>& poses);

// Adds the rows of a motion and their rules: it is at constant `rates`, or through `poses`. `velocity` and `poses` are
// the texts of those rows.
template <typename Form>
void add_motion(Members<Form>& m, const char* velocity, const char* poses) {
  const auto is_at_rates = [](const Form& form) { return form.poses.empty(); };
  m.add("angular_rate_deg_s", nested(&Form::rates, &engine::Rates::angular_rate_deg_s), kAngularRate_deg_s,
        "angular rate about the camera's own axes (opencv)")
      .written_if(is_at_rates);
  m.add("velocity_m_s", nested(&Form::rates, &engine::Rates::velocity_m_s), kVelocity_m_s, velocity)
      .written_if(is_at_rates);
  m.add("poses", &Form::poses, List{TimedPose{{pose_at_time_members()}}, 2, kMaxPoses}, poses)
      .written_if([](const Form& form) { return !form.poses.empty(); });
  m.excludes("poses", {"velocity_m_s", "angular_rate_deg_s"}, "the poses say how the camera moves");
  m.check([](const JsonReader& in, Form& form, const ReadContext&) { check_times(in, form.poses); });
}

// Adds the rows "camera" and "pose", which are optional for the parser: a preset may give the camera, a shutter the
// pose. Returns the pose's row.
template <typename Query>
auto add_camera_and_pose(Members<Query>& m) {
  m.add("camera", nested(&Query::request, &engine::FrameRequest::camera), Object{camera_members()},
        "projection and image size; required unless `camera_preset` has one");
  return m.add("pose", nested(&Query::request, &engine::FrameRequest::pose), Object{pose_members()},
               "position and attitude of the camera; required unless `shutter.poses` is given");
}

// Requires either a pose or a shutter with poses. With the latter, sets `pose` to the interpolated pose of row 0.
void check_pose(const JsonReader& in, const engine::Camera& camera, const std::optional<engine::Shutter>& shutter,
                engine::Pose& pose);
// Returns the largest difference, in seconds, from the sky's epoch to the epoch of a pose in ICRF; 0 if no pose is in
// ICRF. A pose at a time counts at the exposed row that is nearest in time. `utc` is the epoch of poses without one.
// The request `in` must be without faults.
double icrf_lag_s(const JsonReader& in, const engine::Camera& camera, const std::optional<engine::Shutter>& shutter,
                  const std::string& utc, const std::string& sky_utc);
// Returns the rule of check_pose() as a schema condition.
OrderedJson pose_condition(const Limits& limits);

}  // namespace selenograph::api
