// "pose": where the camera is and how it is turned, in whichever way the client knows it.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "api/frame_json.h"
#include "api/ranges.h"

namespace selenograph::api {
namespace {

// Sine of the angle between boresight and up below which the roll would be decided by rounding.
constexpr double kDegenerate = 1e-8;

// Rows are the camera's axes in MOON_ME: x right, y down, z boresight. Empty when up is along the boresight.
std::optional<Eigen::Quaterniond> camera_looking(const Vec3& boresight, const Vec3& up) {
  const Vec3 right = boresight.cross(up);
  if (right.norm() < kDegenerate) return std::nullopt;
  Eigen::Matrix3d camera_from_moon;
  camera_from_moon.row(0) = right.normalized();
  camera_from_moon.row(1) = boresight.cross(right.normalized());
  camera_from_moon.row(2) = boresight;
  return Eigen::Quaterniond(camera_from_moon).normalized();
}

Eigen::Quaterniond read_quaternion(const JsonReader& in) {
  if (!in.object({"w", "x", "y", "z"})) return Eigen::Quaterniond::Identity();
  const Eigen::Vector4d xyzw(in.number("x", kAnyNumber), in.number("y", kAnyNumber), in.number("z", kAnyNumber),
                             in.number("w", kAnyNumber));
  if (!in.good()) return Eigen::Quaterniond::Identity();
  const double length = xyzw.stableNorm();
  if (length == 0) {
    in.fail("is zero: no attitude");
  } else if (!(std::abs(length - 1) <= kQuaternionTolerance)) {
    in.fail(fmt::format("has length {:.6g}; a unit quaternion is needed (within {})", length, kQuaternionTolerance));
  } else {
    return Eigen::Quaterniond(is_unit(xyzw) ? xyzw : Eigen::Vector4d(xyzw / length));
  }
  return Eigen::Quaterniond::Identity();
}

// camera_from_moon in OpenCV axes and MOON_ME, from a quaternion in the client's axes and body frame.
Eigen::Quaterniond resolve_quaternion(const Eigen::Quaterniond& client_camera_from_body, CameraAxes axes,
                                      const Eigen::Matrix3d& moon_me_from_body) {
  // OpenGL's camera has y up and looks along -z: half a turn about x.
  const Eigen::Quaterniond opencv_from_client =
      axes == CameraAxes::opengl ? Eigen::Quaterniond(0, 1, 0, 0) : Eigen::Quaterniond::Identity();
  const Eigen::Quaterniond body_from_moon_me(moon_me_from_body.transpose());
  return opencv_from_client * client_camera_from_body * body_from_moon_me;
}

// North is the Moon's axis. Where the boresight is along it but the target is not on the equator (straight down at a
// pole, say), the target's own north still says which way is up; at a pole that is the direction of longitude 180
// (north pole) or 0 (south pole), as local_axes has it.
std::optional<Eigen::Quaterniond> camera_north_up(const Vec3& boresight, const Vec3& target_m) {
  if (const auto q = camera_looking(boresight, Vec3::UnitZ())) return q;
  return camera_looking(boresight, local_axes(target_m).north);
}

std::optional<Vec3> read_up(const JsonReader& in) {
  if (in.value().is_string()) {
    if (in.value() != "north") in.fail("must be \"north\" or a vector [x, y, z] in MOON_ME");
    return std::nullopt;
  }
  const std::optional<Vec3> up = direction_of(in.vector(kAnyNumber));
  if (!up && in.good()) in.fail("is zero: no direction");
  return up;
}

Eigen::Quaterniond read_look_at(const JsonReader& in, const Vec3& position_m) {
  const Eigen::Quaterniond fallback = Eigen::Quaterniond::Identity();
  if (!in.object({"lat_deg", "lon_deg", "height_m", "up"})) return fallback;
  const Geographic place{in.number("lat_deg", kLatitude_deg), in.number("lon_deg", kLongitude_deg),
                         in.number("height_m", kHeight_m, 0)};
  const std::optional<Vec3> up = in.has("up") ? read_up(in.at("up")) : std::nullopt;
  if (!in.good()) return fallback;
  const Vec3 target_m = to_cartesian(place);
  const std::optional<Vec3> boresight = direction_of(target_m - position_m);
  if (!boresight) {
    in.fail("is where the camera is: no direction");
    return fallback;
  }
  const auto attitude = up ? camera_looking(*boresight, *up) : camera_north_up(*boresight, target_m);
  if (!attitude) in.fail("up", up ? "is along the boresight" : "\"north\" is along the boresight: give a vector");
  return attitude.value_or(fallback);
}

Eigen::Quaterniond read_nadir(const JsonReader& in, const Vec3& position_m) {
  const Eigen::Quaterniond fallback = Eigen::Quaterniond::Identity();
  if (!in.object({"up_azimuth_deg"})) return fallback;
  const double azimuth = in.number("up_azimuth_deg", kAzimuth_deg, 0) * kRadiansPerDegree;
  if (!in.good()) return fallback;
  if (position_m.norm() == 0) {
    in.fail("has no direction from the Moon's centre");
    return fallback;
  }
  const EastNorthUp local = local_axes(position_m);
  const Vec3 up = std::cos(azimuth) * local.north + std::sin(azimuth) * local.east;
  return camera_looking(-local.up, up).value_or(fallback);
}

// moon_from_object of an object that stands: its z up, its x toward an azimuth.
Eigen::Quaterniond read_upright(const JsonReader& in, const Vec3& position_m) {
  if (!in.object({"azimuth_deg"})) return Eigen::Quaterniond::Identity();
  const double azimuth = in.number("azimuth_deg", kAzimuth_deg, 0) * kRadiansPerDegree;
  if (!in.good()) return Eigen::Quaterniond::Identity();
  if (position_m.norm() == 0) {
    in.fail("has no direction from the Moon's centre");
    return Eigen::Quaterniond::Identity();
  }
  const EastNorthUp local = local_axes(position_m);
  Eigen::Matrix3d moon_from_object;
  moon_from_object.col(0) = std::cos(azimuth) * local.north + std::sin(azimuth) * local.east;
  moon_from_object.col(2) = local.up;
  moon_from_object.col(1) = local.up.cross(Vec3(moon_from_object.col(0)));
  return Eigen::Quaterniond(moon_from_object).normalized();
}

Vec3 read_geodetic(const JsonReader& in, engine::BodyFrame frame) {
  if (frame != engine::BodyFrame::moon_me) {
    // The two frames are 860 m apart: taking one for the other silently is the one mistake not to make.
    in.fail("is MOON_ME always; with another frame give position_m");
  }
  return to_cartesian(read_place(in, true));
}

Vec3 read_position(const JsonReader& in, engine::BodyFrame frame) {
  const std::string_view how = in.alternative({"position_m", "geodetic"}, true);
  if (how.empty()) return Vec3::Zero();
  const Vec3 position_m = how == "position_m" ? Vec3(engine::moon_me_from(frame) * in.at(how).vector(kCoordinate_m))
                                              : read_geodetic(in.at(how), frame);
  // Turning it or adding the Moon's radius can take it out of the range that it must be in to be a request again.
  if (in.good() && !(position_m.cwiseAbs().maxCoeff() <= kCoordinate_m.max)) {
    in.fail(how, fmt::format("lies more than {} m from the Moon's centre along an axis of MOON_ME", kCoordinate_m.max));
  }
  return position_m;
}

// Of q and -q, which are one attitude, the one whose first component of w, x, y, z that is not zero is positive, and no
// zero negative: one attitude has one text and one content hash.
Eigen::Quaterniond canonical(Eigen::Quaterniond q) {
  if (!is_unit(q.coeffs())) q.normalize();
  for (const double component : {q.w(), q.x(), q.y(), q.z()}) {
    if (component == 0) continue;
    if (component < 0) q.coeffs() = -q.coeffs();
    break;
  }
  q.coeffs().array() += 0.0;  // -0 + 0 is 0
  return q;
}

Eigen::Quaterniond read_attitude(const JsonReader& in, const Vec3& position_m, engine::BodyFrame frame,
                                 CameraAxes axes) {
  const std::string_view how = in.alternative({"camera_from_moon", "moon_from_camera", "look_at", "nadir"}, true);
  if (how == "look_at") return read_look_at(in.at(how), position_m);
  if (how == "nadir") return read_nadir(in.at(how), position_m);
  if (how.empty()) return Eigen::Quaterniond::Identity();
  const Eigen::Quaterniond given = read_quaternion(in.at(how));
  return resolve_quaternion(how == "moon_from_camera" ? given.conjugate() : given, axes, engine::moon_me_from(frame));
}

}  // namespace

Geographic read_place(const JsonReader& in, bool with_height, std::optional<double> height_fallback_m) {
  Geographic place;
  if (with_height ? !in.object({"lat_deg", "lon_deg", "height_m"}) : !in.object({"lat_deg", "lon_deg"})) return place;
  place.lat_deg = in.number("lat_deg", kLatitude_deg);
  place.lon_deg = in.number("lon_deg", kLongitude_deg);
  if (!with_height) return place;
  place.height_m =
      height_fallback_m ? in.number("height_m", kHeight_m, *height_fallback_m) : in.number("height_m", kHeight_m);
  return place;
}

void read_object_pose(const JsonReader& in, engine::SceneObject& object) {
  if (!in.object({"frame", "position_m", "geodetic", "moon_from_object", "object_from_moon", "upright"})) return;
  const auto frame = in.word("frame", Words<engine::BodyFrame>(kBodyFrames), engine::BodyFrame::moon_me);
  object.position_m = read_position(in, frame);
  const std::string_view how = in.alternative({"moon_from_object", "object_from_moon", "upright"}, true);
  if (how == "upright") {
    object.moon_from_object = canonical(read_upright(in.at(how), object.position_m));
  } else if (!how.empty()) {
    const Eigen::Quaterniond given = read_quaternion(in.at(how)),
                             body_from_object = how == "object_from_moon" ? given.conjugate() : given;
    object.moon_from_object = canonical(Eigen::Quaterniond(engine::moon_me_from(frame)) * body_from_object);
  }
}

engine::Pose read_pose(const JsonReader& in) {
  engine::Pose pose;
  if (!in.object(
          {"frame", "position_m", "geodetic", "camera_from_moon", "moon_from_camera", "look_at", "nadir", "axes"})) {
    return pose;
  }
  const auto frame = in.word("frame", Words<engine::BodyFrame>(kBodyFrames), engine::BodyFrame::moon_me);
  const auto axes = in.word("axes", Words<CameraAxes>(kCameraAxes), CameraAxes::opencv);
  pose.position_m = read_position(in, frame);
  pose.camera_from_moon = canonical(read_attitude(in, pose.position_m, frame, axes));
  return pose;
}

}  // namespace selenograph::api
