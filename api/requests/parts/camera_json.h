// "camera": a pinhole or a fisheye, by field of view, by intrinsics in pixels, or by focal length and pixel pitch; or
// CAHVOR's vectors, or a table of lines of sight.
#pragma once

#include <cstdint>
#include <optional>

#include "api/schema/member_kinds.h"
#include "api/schema/members.h"
#include "engine/frame/camera.h"

namespace selenograph::api {

enum class DistortionModel { brown_conrady, opencv, kannala_brandt };

// "distortion" as a client writes it: coefficients of any model; those that the model lacks stay 0.
struct DistortionForm {
  DistortionModel model = DistortionModel::brown_conrady;
  double k1 = 0, k2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0, p1 = 0, p2 = 0, s1 = 0, s2 = 0, s3 = 0, s4 = 0;
  double tau_x_deg = 0, tau_y_deg = 0;
};

// "cahvor" as a client writes it: without O it is A.
struct CahvorForm {
  Vec3 a = Vec3::zero(), h = Vec3::zero(), v = Vec3::zero(), r = Vec3::zero();
  std::optional<Vec3> o;
  double linearity = 1;
};

// "camera" as a client writes it: exactly one of fov_deg, fx, focal_length_mm, cahvor and
// lines_of_sight gives the focal length.
struct CameraForm {
  engine::CameraModel model = engine::CameraModel::pinhole;
  int width = 0, height = 0;
  std::optional<double> fov_deg, fx, fy, cx, cy, focal_length_mm, pixel_pitch_um;
  std::optional<DistortionForm> distortion;
  std::optional<engine::Cahvor> cahvor;
  std::optional<Named<engine::SightTable>> lines_of_sight;
};
const Members<CameraForm, engine::Camera>& camera_members();

// Reports a camera whose image is larger than the service renders. Calls that render nothing do not check this.
void check_rendered_size(const JsonReader& in, const engine::Camera& camera, const Limits& limits);
// Returns the same rule as a schema condition on the member `camera` of a request.
OrderedJson rendered_size_condition(const Limits& limits);

}  // namespace selenograph::api
