// Places and poses of cameras and objects, in any of the accepted forms.
//
// A quaternion or matrix camera_from_moon rotates vectors of `frame` (the Moon's side) into the camera's `axes`:
//
//        opencv                 opengl
//      +------> x               y ^   (-z: boresight, into the page)
//      |  (z: boresight,          |
//      v   into the page)         +------> x
//      y
//
// `frame` is also the frame of `position_m`. Latitudes and longitudes (`geodetic`, `look_at`) and `look_at.up` are
// always MOON_ME. The engine's poses are MOON_ME and opencv.
#pragma once

#include <optional>
#include <string_view>
#include <utility>

#include "api/json/ranges.h"
#include "api/schema/member_kinds.h"
#include "dem/grid/rotation.h"
#include "engine/frame/pose.h"
#include "engine/sky/ephemeris.h"

namespace selenograph::api {

// Frame of positions and attitudes: body-fixed, or (empty) ICRF axes at the Moon's centre.
using PoseFrame = std::optional<engine::BodyFrame>;
inline constexpr std::pair<std::string_view, PoseFrame> kPoseFrames[] = {
    {"MOON_ME", engine::BodyFrame::moon_me},
    {"MOON_PA_DE421", engine::BodyFrame::moon_pa_de421},
    {"MOON_PA_DE440", engine::BodyFrame::moon_pa_de440},
    {"ICRF", std::nullopt},
    {"J2000", std::nullopt},  // 0.02 arcsec from ICRF: 0.2 m on the ground
};
// Names of frames that are rejected, with the text that tells the client what to write instead.
inline constexpr std::pair<std::string_view, std::string_view> kRejectedFrames[] = {
    {"MOON_PA", "principal axes belong to an ephemeris: \"MOON_PA_DE421\" or \"MOON_PA_DE440\"? MOON_ME is 860 m away"},
    {"IAU_MOON",
     "IAU_MOON is up to 0.01 degrees, 300 m on the ground, from MOON_ME: rotate the pose (SPICE: pxform(\"IAU_MOON\", "
     "\"MOON_ME\", et)), or say \"MOON_ME\" where that does not matter"},
    {"EME2000", "EME2000 is \"J2000\""},
};

// Ranges of rates.
inline constexpr Vector kAngularRate_deg_s{{-3600, 3600}, "deg/s"};
inline constexpr Vector kVelocity_m_s{{-1e6, 1e6}, "m/s"};

// Camera axes of the client's attitudes: see the drawing above.
enum class CameraAxes { opencv, opengl };
inline constexpr std::pair<std::string_view, CameraAxes> kCameraAxes[] = {
    {"opencv", CameraAxes::opencv},
    {"opengl", CameraAxes::opengl},
};

// Adds "lat_deg" and "lon_deg" of a form with members of these names.
template <typename Form, typename Value>
void add_latitude_and_longitude(Members<Form, Value>& m) {
  m.add("lat_deg", &Form::lat_deg, Number{kLatitude_deg, "deg"}, "planetocentric latitude, MOON_ME").required();
  m.add("lon_deg", &Form::lon_deg, Number{kLongitude_deg, "deg"}, "longitude, east-positive, MOON_ME").required();
}

const Members<Geographic>& place_members();  // latitude and longitude; height_m stays 0
// A place with a height above the sphere or above the ground: one of them is given.
struct GeodeticForm {
  double lat_deg = 0, lon_deg = 0;
  std::optional<double> height_m, height_above_ground_m;
};
const Members<GeodeticForm, Geographic>& geodetic_members();

// A quaternion before it is normalised: w is the scalar part.
struct QuaternionForm {
  double w = 0, x = 0, y = 0, z = 0;
};

// An epoch, as UTC or as seconds of TDB since J2000.0.
struct EpochForm {
  std::optional<std::string> utc;
  std::optional<double> et_s;
  // Returns the name of the member that the client wrote, for error messages.
  const char* member() const { return et_s ? "et_s" : "utc"; }
  // Returns the epoch as UTC; empty if the client wrote neither member. Throws ImpossibleRequest.
  std::string as_utc() const;
};
inline constexpr std::string_view kEtMeaning =
    "Ephemeris Time as in SPICE, seconds of TDB since J2000.0; instead of utc";

// Position, common to cameras and objects. The epoch is that of the frame ICRF.
struct PositionForm : EpochForm {
  PoseFrame frame = engine::BodyFrame::moon_me;
  std::optional<Vec3> position_m;
  std::optional<Geographic> geodetic;
};

// Up direction of an image: north, the local vertical below the camera, or a vector.
struct ImageUp {
  enum class Kind { north, zenith, direction } kind = Kind::north;
  Vec3 direction = Vec3::zero();  // unit, MOON_ME
};
// Boresight through a point, which need not lie on the terrain.
struct LookAt {
  double lat_deg = 0, lon_deg = 0, height_m = 0;
  std::optional<double> height_above_ground_m;  // instead of height_m
  ImageUp up;
};
// Boresight to the Moon's centre, or tilted from there.
struct Nadir {
  double up_azimuth_deg = 0;          // compass azimuth of the image's up direction (-y) before the tilt
  double tilt_deg = 0;                // angle between boresight and nadir
  std::optional<double> azimuth_deg;  // compass azimuth toward which the boresight is tilted; empty: up_azimuth_deg
};
// A camera's pose as a client writes it: exactly one of the attitudes is given.
struct PoseForm : PositionForm {
  std::optional<Quat> camera_from_moon, moon_from_camera;
  std::optional<Mat3> camera_from_moon_matrix, moon_from_camera_matrix;
  std::optional<LookAt> look_at;
  std::optional<Nadir> nadir;
  CameraAxes axes = CameraAxes::opencv;
};
const Members<PoseForm, engine::Pose>& pose_members();

// Returns q or -q, which are the same attitude: the first non-zero component of w, x, y, z is positive, and no zero is
// negative. Thus an attitude has one text and one content hash.
Quat canonical(Quat q);

// An object's pose in MOON_ME.
struct ObjectPose {
  Vec3 position_m = Vec3::zero();
  Quat moon_from_object = Quat::identity();
};
// Attitude of an object whose z axis is the local vertical.
struct Upright {
  double azimuth_deg = 0;  // compass azimuth of the object's x axis
};
// An object's pose as a client writes it: exactly one of the attitudes is given.
struct ObjectPoseForm : PositionForm {
  std::optional<Quat> moon_from_object, object_from_moon;
  std::optional<Upright> upright;
};
const Members<ObjectPoseForm, ObjectPose>& object_pose_members();

}  // namespace selenograph::api
