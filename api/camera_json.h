// "camera": a pinhole camera by field of view or by intrinsics.
#pragma once

#include <optional>

#include "api/members.h"
#include "engine/frame/camera.h"

namespace selenograph::api {

struct CameraForm {
  int width = 0, height = 0;
  std::optional<double> fov_deg, fx, fy, cx, cy;
  engine::Distortion distortion;
};
const Members<CameraForm, engine::Camera>& camera_members();

}  // namespace selenograph::api
