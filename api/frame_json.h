// A request for a frame: JSON <-> engine::FrameRequest, as the contract says. The way from untrusted to resolved
// values.
//
// What frame and axes apply to: `pose.frame` names the body frame of `position_m` and of the MOON side of the
// quaternions, `pose.axes` the camera side of the quaternions. Places in latitude and longitude (`geodetic`, `look_at`,
// `subsolar`, `local`), `look_at.up` and `sun.direction` are MOON_ME always.
#pragma once

#include <optional>
#include <string_view>
#include <utility>

#include "api/assets.h"
#include "api/json_reader.h"
#include "api/objects_json.h"
#include "api/surface_json.h"
#include "engine/frame/request.h"
#include "engine/radiometry/ephemeris.h"

namespace selenograph::api {

inline constexpr std::pair<std::string_view, engine::BodyFrame> kBodyFrames[] = {
    {"MOON_ME", engine::BodyFrame::moon_me},
    {"MOON_PA_DE421", engine::BodyFrame::moon_pa_de421},
    {"MOON_PA_DE440", engine::BodyFrame::moon_pa_de440},
};

enum class CameraAxes { opencv, opengl };
inline constexpr std::pair<std::string_view, CameraAxes> kCameraAxes[] = {
    {"opencv", CameraAxes::opencv},
    {"opengl", CameraAxes::opengl},
};

inline constexpr std::pair<std::string_view, engine::Visibility> kVisibilities[] = {
    {"auto", engine::Visibility::automatic},
    {"zbuffer", engine::Visibility::zbuffer},
    {"raytrace", engine::Visibility::raytrace}};
std::string_view visibility_name(engine::Visibility visibility);

struct FrameQuery {
  engine::FrameRequest request;
  // Time for which the accuracy is to be chosen; empty: `request.accuracy` was given or is the default.
  std::optional<double> budget_ms;
  std::string atmosphere_name;  // that request.atmosphere was found by
  SurfaceQuery surface;
  std::vector<ObjectQuery> objects;
  bool sun_given = false;  // false: no product needs one, request.sun means nothing
};

// Throws RequestError("invalid_request") with every fault found.
FrameQuery read_frame(const Json& body, const Limits& limits, const Assets& assets = Assets());

// The parts, for calls that take a camera, a pose or a Sun on their own. Faults go to the reader's findings.
engine::Camera read_camera(const JsonReader& in, const Limits& limits);
engine::Pose read_pose(const JsonReader& in);
engine::Sun read_sun(const JsonReader& in);
// Fills in position and attitude.
void read_object_pose(const JsonReader& in, engine::SceneObject& object);
nlohmann::ordered_json object_pose_json(const engine::SceneObject& object);
// {"lat_deg", "lon_deg"} and, where `with_height`, "height_m" (`height_fallback_m` if left out, required when that is
// empty).
Geographic read_place(const JsonReader& in, bool with_height, std::optional<double> height_fallback_m = std::nullopt);

// The request as it was understood: pose in MOON_ME and OpenCV axes, intrinsics in pixels, a Sun vector. A valid
// request itself: sent back to the service it gives the same frame. Same meaning, same text, so it is also what ETag is
// made from.
nlohmann::ordered_json resolved_json(const FrameQuery& query);

}  // namespace selenograph::api
