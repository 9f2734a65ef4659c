// The Moon's limb and terminator in an image: POST /v1/limb.
#pragma once

#include <limits>
#include <optional>

#include "engine/frame/camera.h"
#include "engine/frame/pose.h"
#include "engine/frame/sun.h"

namespace selenograph::engine {

// `points` azimuths, from 0 in equal steps.
struct LimbRequest {
  Camera camera;
  Pose pose;
  int points = 360;
  std::optional<Sun> sun{};  // whose terminator is asked for
};

// Numbers are NaN where there are none. An azimuth is an angle around the direction to the Moon's centre, from +x
// toward +y of the camera's axes turned by the shortest way so that +z points at the centre.
struct LimbPoint {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

  double azimuth_deg = 0;
  // Of the terrain, unless there is no data: the largest angle from the Moon's centre at which a ray meets it, and what
  // that ray meets.
  double angle_deg = kNone, range_m = kNone;
  Vec3 position_m = Vec3::Constant(kNone);
  double x_px = kNone, y_px = kNone;
  bool in_frame = false;
  // Of the sphere of 1 737 400 m.
  double sphere_angle_deg = kNone, sphere_x_px = kNone, sphere_y_px = kNone;
  bool known() const { return angle_deg == angle_deg; }
};

// Azimuths are angles around the direction to the Sun's centre, from the Moon's north pole through the east of what the
// Sun sees. The terrain's terminator is its limb as the Sun's centre sees it: in the half plane of an azimuth the last
// ground toward the night that a ray from there meets. Places are imaged whether the camera sees them or not.
struct TerminatorPoint {
  static constexpr double kNone = LimbPoint::kNone;

  double azimuth_deg = 0;
  Vec3 position_m = Vec3::Constant(kNone);  // NaN: no data
  double x_px = kNone, y_px = kNone;
  bool in_frame = false, visible = false;  // visible: in the frame, and no terrain hides it
  double sphere_x_px = kNone, sphere_y_px = kNone;
  bool sphere_visible = false;  // on the camera's side of the sphere of 1 737 400 m, and in the frame
  bool known() const { return position_m.x() == position_m.x(); }
};

}  // namespace selenograph::engine
