// Places and poses of cameras and objects, in any of the accepted forms.
//
// `frame` is the frame of `position_m` and of the MOON side of quaternions and matrices, `axes` defines their camera
// side. Latitudes, longitudes (`geodetic`, `look_at`) and `look_at.up` are always MOON_ME.
#pragma once

#include <optional>
#include <string_view>
#include <utility>

#include "api/json/ranges.h"
#include "api/schema/member_kinds.h"
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
inline constexpr std::pair<std::string_view, std::string_view> kOtherFrames[] = {
    {"MOON_PA", "principal axes belong to an ephemeris: \"MOON_PA_DE421\" or \"MOON_PA_DE440\"? MOON_ME is 860 m away"},
    {"IAU_MOON",
     "IAU_MOON is up to 0.01 degrees, 300 m on the ground, from MOON_ME: rotate the pose (SPICE: pxform(\"IAU_MOON\", "
     "\"MOON_ME\", et)), or say \"MOON_ME\" where that does not matter"},
    {"EME2000", "EME2000 is \"J2000\""},
};

// Ranges of rates.
inline constexpr Vector kAngularRate_deg_s{{-3600, 3600}, "deg/s"};
inline constexpr Vector kVelocity_m_s{{-1e6, 1e6}, "m/s"};

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

const Members<Geographic>& place_members();     // on the sphere
const Members<Geographic>& geodetic_members();  // with a height

struct QuaternionForm {
  double w = 0, x = 0, y = 0, z = 0;
};

// An epoch, as UTC or as seconds of TDB since J2000.0.
struct EpochForm {
  std::optional<std::string> utc;
  std::optional<double> et_s;
  // Name of the member that is given.
  const char* member() const { return et_s ? "et_s" : "utc"; }
  // As UTC; empty: none is given. Throws ImpossibleRequest.
  std::string as_utc() const;
};
inline constexpr std::string_view kEtMeaning =
    "Ephemeris Time as in SPICE, seconds of TDB since J2000.0; instead of utc";

// Position, common to cameras and objects; its epoch is ICRF's.
struct PositionForm : EpochForm {
  PoseFrame frame = engine::BodyFrame::moon_me;
  std::optional<Vec3> position_m;
  std::optional<Geographic> geodetic;
};

// Up direction of an image: north, the local vertical below the camera, or a vector.
struct ImageUp {
  enum class Kind { north, zenith, direction } kind = Kind::north;
  Vec3 direction = Vec3::Zero();  // unit, MOON_ME
};
struct LookAt {
  double lat_deg = 0, lon_deg = 0, height_m = 0;
  ImageUp up;
};
struct Nadir {
  double up_azimuth_deg = 0;
};
struct PoseForm : PositionForm {
  std::optional<Eigen::Quaterniond> camera_from_moon, moon_from_camera;
  std::optional<Eigen::Matrix3d> camera_from_moon_matrix, moon_from_camera_matrix;
  std::optional<LookAt> look_at;
  std::optional<Nadir> nadir;
  CameraAxes axes = CameraAxes::opencv;
};
const Members<PoseForm, engine::Pose>& pose_members();

// Chooses between q and -q, which are the same attitude: the first non-zero component of w, x, y, z is positive, and no
// zero is negative. An attitude has one text and one content hash.
Eigen::Quaterniond canonical(Eigen::Quaterniond q);

struct ObjectPose {
  Vec3 position_m = Vec3::Zero();
  Eigen::Quaterniond moon_from_object = Eigen::Quaterniond::Identity();
};
struct Upright {
  double azimuth_deg = 0;
};
struct ObjectPoseForm : PositionForm {
  std::optional<Eigen::Quaterniond> moon_from_object, object_from_moon;
  std::optional<Upright> upright;
};
const Members<ObjectPoseForm, ObjectPose>& object_pose_members();

}  // namespace selenograph::api
