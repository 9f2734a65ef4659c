// Row times: cameras whose rows are exposed one after the other. Frames and landmarks share it.
#pragma once

#include <optional>

#include "api/requests/parts/pose_json.h"
#include "engine/frame/camera.h"
#include "engine/frame/shutter.h"

namespace selenograph::api {

const Members<engine::Shutter>& shutter_members();

// A pose is given, or a shutter's poses are instead: then the pose is the one that they give for row 0.
void check_pose(const JsonReader& in, const engine::Camera& camera, const std::optional<engine::Shutter>& shutter,
                engine::Pose& pose);
// The same as a condition of the schema.
OrderedJson pose_condition(const Limits& limits);

}  // namespace selenograph::api
