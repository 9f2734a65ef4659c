// "camera": a pinhole or a fisheye, by field of view, by intrinsics in pixels, or by focal length and pixel pitch.
#pragma once

#include <cstdint>
#include <optional>

#include "api/schema/members.h"
#include "engine/frame/camera.h"

namespace selenograph::api {

struct DistortionForm {
  engine::CameraModel model = engine::CameraModel::pinhole;  // camera model that it belongs to
  double k1 = 0, k2 = 0, k3 = 0, k4 = 0, p1 = 0, p2 = 0;
};

struct CameraForm {
  engine::CameraModel model = engine::CameraModel::pinhole;
  int width = 0, height = 0;
  std::optional<double> fov_deg, fx, fy, cx, cy, focal_length_mm, pixel_pitch_um;
  std::optional<DistortionForm> distortion;
};
const Members<CameraForm, engine::Camera>& camera_members();

// Largest side of an image, px.
std::int64_t largest_side(const Limits& limits);

}  // namespace selenograph::api
