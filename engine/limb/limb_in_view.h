// The Moon's terrain-true limb and terminator in a camera's image: POST /v1/limb.
#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "engine/frame/camera.h"
#include "engine/frame/pose.h"
#include "engine/frame/sun.h"

namespace selenograph::engine {

struct RenderContext;

// Request for `points` azimuths, from 0 in equal steps.
struct LimbRequest {
  Camera camera;
  Pose pose;
  int points = 360;
  std::optional<Sun> sun{};  // Sun of the terminator; empty: no terminator
};

// A point of the limb; missing numbers are NaN. An azimuth is an angle around the direction to the Moon's centre, from
// +x toward +y of the camera's axes, turned by the shortest rotation that lets +z point at the centre.
struct LimbPoint {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

  double azimuth_deg = 0;
  // Limb of the terrain: the largest angle from the Moon's centre at which a ray hits it, and the range and position of
  // that hit; NaN without data.
  double angle_deg = kNone, range_m = kNone;
  Vec3 position_m = Vec3::constant(kNone);
  double x_px = kNone, y_px = kNone;
  bool in_frame = false;
  // Limb of the sphere of 1 737 400 m.
  double sphere_angle_deg = kNone, sphere_x_px = kNone, sphere_y_px = kNone;
  bool known() const { return angle_deg == angle_deg; }
};

// A point of the terminator. Azimuths are angles around the direction to the Sun's centre, from the Moon's north pole
// through the east as viewed from the Sun. The terrain's terminator is its limb as viewed from the Sun's centre: in the
// half plane of an azimuth, the last ground toward the night that a ray from there hits. Pixel coordinates are set
// even if the camera cannot see the position.
struct TerminatorPoint {
  static constexpr double kNone = LimbPoint::kNone;

  double azimuth_deg = 0;
  Vec3 position_m = Vec3::constant(kNone);  // NaN: no data
  double x_px = kNone, y_px = kNone;
  bool in_frame = false, visible = false;  // visible: in the frame, and no terrain hides it
  double sphere_x_px = kNone, sphere_y_px = kNone;
  bool sphere_visible = false;  // on the camera's side of the sphere of 1 737 400 m, and in the frame
  bool known() const { return position_m.x() == position_m.x(); }
};

// Returns the limb of the finest terrain, without rocks, and that of the sphere, in order of azimuth. A point has no
// terrain if its line of sight, where it is lower than the highest terrain, passes over ground without data. Throws
// ImpossibleRequest for a camera below the terrain, DataError and Cancelled.
std::vector<LimbPoint> find_limb(const LimbRequest& request, const RenderContext& context);

// Returns the terminator of the request's Sun, in order of azimuth; empty without a Sun. Throws as find_limb does.
std::vector<TerminatorPoint> find_terminator(const LimbRequest& request, const RenderContext& context);

}  // namespace selenograph::engine
