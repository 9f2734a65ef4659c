// Row times: cameras whose rows are exposed one after the other. Frames and landmarks share it.
#pragma once

#include <optional>
#include <vector>

#include "api/requests/parts/pose_json.h"
#include "engine/frame/camera.h"
#include "engine/frame/shutter.h"

namespace selenograph::api {

const Members<engine::Shutter>& shutter_members();

// A pose at a time, of which at least two give a motion; their times must rise, which check_times() reports at "poses".
inline constexpr std::size_t kMostPoses = 1000;
const Members<engine::PoseAtTime>& pose_at_time_members();
void check_times(const JsonReader& in, const std::vector<engine::PoseAtTime>& poses);

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
