// "camera": a pinhole or a fisheye, by field of view, by intrinsics in pixels, or by focal length and pixel pitch.
#pragma once

#include <cstdint>
#include <optional>

#include "api/schema/members.h"
#include "engine/frame/camera.h"

namespace selenograph::api {

// "distortion" as a client writes it: coefficients of either model; those that the model lacks stay 0.
struct DistortionForm {
  engine::CameraModel model = engine::CameraModel::pinhole;  // camera model that the distortion model belongs to
  double k1 = 0, k2 = 0, k3 = 0, k4 = 0, p1 = 0, p2 = 0;
};

// "camera" as a client writes it: exactly one of fov_deg, fx and focal_length_mm gives the focal length.
struct CameraForm {
  engine::CameraModel model = engine::CameraModel::pinhole;
  int width = 0, height = 0;
  std::optional<double> fov_deg, fx, fy, cx, cy, focal_length_mm, pixel_pitch_um;
  std::optional<DistortionForm> distortion;
};
const Members<CameraForm, engine::Camera>& camera_members();

// Reports a camera whose image is larger than the service renders. Calls that render nothing do not check this.
void check_rendered_size(const JsonReader& in, const engine::Camera& camera, const Limits& limits);
// Returns the same rule as a schema condition on the member `camera` of a request.
OrderedJson rendered_size_condition(const Limits& limits);

}  // namespace selenograph::api
