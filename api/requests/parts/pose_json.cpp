// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/pose_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/error.h"

namespace selenograph::api {
namespace {

// Minimum sine of the angle between boresight and up. Below it rounding would decide the roll.
constexpr double kMinSine = 1e-8;

// Returns camera_from_moon for a boresight and an up direction, both MOON_ME and unit; empty if they are parallel. The
// rows of the matrix are the camera's axes in MOON_ME: x right, y down, z boresight.
std::optional<Quat> camera_along(const Vec3& boresight, const Vec3& up) {
  const Vec3 right = boresight.cross(up);
  if (right.norm() < kMinSine) return std::nullopt;
  const auto camera_from_moon = Mat3::from_rows(right.normalized(), boresight.cross(right.normalized()), boresight);
  return Quat(camera_from_moon).normalized();
}

// Returns camera_from_moon in OpenCV axes and MOON_ME, from a quaternion in the client's axes and body frame.
Quat resolve_quaternion(const Quat& client_camera_from_body, CameraAxes axes, const Mat3& moon_me_from_body) {
  // OpenGL's camera has y up and looks along -z: half a turn about x.
  const Quat opencv_from_client = axes == CameraAxes::opengl ? Quat(0, 1, 0, 0) : Quat::identity();
  const Quat body_from_moon_me(moon_me_from_body.transpose());
  return opencv_from_client * client_camera_from_body * body_from_moon_me;
}

// Returns camera_from_moon with the Moon's rotation axis up in the image. If the boresight is along that axis, as
// straight down at a pole, the local north at the target defines up; empty if that is along the boresight too.
std::optional<Quat> camera_north_up(const Vec3& boresight, const Vec3& target_north) {
  if (const auto q = camera_along(boresight, Vec3::unit_z())) return q;
  return camera_along(boresight, target_north);
}

// "look_at.up": the word "north", the word "zenith", or a direction.
struct Up {
  using Value = ImageUp;
  std::optional<Value> read(const JsonReader& in, const ReadContext&) const {
    if (in.value().is_string()) {
      if (in.value() == "north") return Value();
      if (in.value() == "zenith") return Value{Value::Kind::zenith};
      in.fail("must be \"north\", \"zenith\" or a vector [x, y, z] in MOON_ME");
      return std::nullopt;
    }
    const std::optional<Vec3> vector = in.vector(kAnyNumber);
    if (!vector) return std::nullopt;
    if (const auto up = direction_of(*vector)) return Value{Value::Kind::direction, *up};
    in.fail("is zero: not a direction");
    return std::nullopt;
  }
  OrderedJson write(const Value& up) const {
    if (up.kind == Value::Kind::direction) return vector_json(up.direction);
    return up.kind == Value::Kind::zenith ? "zenith" : "north";
  }
  OrderedJson schema(const Limits& limits) const {
    return {{"oneOf",
             {{{"type", "string"}, {"const", "north"}},
              {{"type", "string"}, {"const", "zenith"}},
              Vector{kAnyNumber}.schema(limits)}}};
  }
};

// A rotation matrix, rows first.
struct RotationMatrix {
  using Value = Mat3;
  static constexpr double kTolerance = 1e-6;
  std::optional<Value> read(const JsonReader& in, const ReadContext&) const {
    const std::size_t before = in.faults();
    Value transpose = Value::zero();
    int row = 0;
    in.elements(3, 3, [&](const JsonReader& element) {
      transpose.col(row++) = element.vector(kAnyNumber).value_or(Vec3::zero());
    });
    if (in.faults() != before) return std::nullopt;
    const Value m = transpose.transpose();
    const double error = (m * m.transpose() - Value::identity()).max_abs();
    if (!(error <= kTolerance)) {
      in.fail(fmt::format("is not orthonormal: its rows' products are off by {:.3g}, more than {}", error, kTolerance));
    } else if (m.determinant() < 0) {
      in.fail("has determinant -1: a reflection, not a rotation. Does an axis point the other way?");
    } else {
      return m;
    }
    return std::nullopt;
  }
  OrderedJson write(const Value& m) const {
    return OrderedJson::array({vector_json(m.row(0)), vector_json(m.row(1)), vector_json(m.row(2))});
  }
  OrderedJson schema(const Limits& limits) const { return array_schema(Vector{kAnyNumber}.schema(limits), 3, 3); }
};

Quat quaternion_of(const Mat3& m) { return Quat(m).normalized(); }

// Returns the length, also where squares of the components are not representable.
double stable_norm(const Quat& q) {
  const double largest = std::max({std::abs(q.x), std::abs(q.y), std::abs(q.z), std::abs(q.w)});
  if (!(largest > std::numeric_limits<double>::min())) return largest;
  const double scale = 1 / largest;
  return largest * Quat(q.w * scale, q.x * scale, q.y * scale, q.z * scale).norm();
}

// Returns the quaternion normalised; one that is a unit to double precision keeps its bits.
std::optional<Quat> resolve_unit(const JsonReader& in, const QuaternionForm& form, const ReadContext&) {
  const Quat q(form.w, form.x, form.y, form.z);
  const double length = stable_norm(q);
  if (length == 0) {
    in.fail("is zero: not an attitude");
  } else if (!(std::abs(length - 1) <= kQuaternionTolerance)) {
    in.fail(fmt::format("has length {:.6g}; a unit quaternion is needed (within {})", length, kQuaternionTolerance));
  } else {
    return is_unit(q) ? q : Quat(q.w / length, q.x / length, q.y / length, q.z / length);
  }
  return std::nullopt;
}

const Members<QuaternionForm, Quat>& quaternion_members() {
  static const auto table = make_table<Members<QuaternionForm, Quat>>(
      "Quaternion", "A unit quaternion. Its length must be within 0.001 of 1; it is normalised.", [](auto& m) {
        m.add("w", &QuaternionForm::w, Number{kAnyNumber}, "scalar part").required();
        m.add("x", &QuaternionForm::x, Number{kAnyNumber}, "vector part").required();
        m.add("y", &QuaternionForm::y, Number{kAnyNumber}, "vector part").required();
        m.add("z", &QuaternionForm::z, Number{kAnyNumber}, "vector part").required();
        m.resolve(resolve_unit);
        m.unresolve([](const Quat& q) { return QuaternionForm{q.w, q.x, q.y, q.z}; });
      });
  return *table;
}

// Adds the rows of a PositionForm, and the rule that exactly one of position_m and geodetic is required.
template <typename Form, typename Value>
void add_position(Members<Form, Value>& m) {
  m.add("frame", &Form::frame, Word<PoseFrame>{kPoseFrames, kRejectedFrames},
        "frame of position_m and of the attitude: a body-fixed lunar frame, or ICRF axes at the Moon's centre; J2000 "
        "is taken as ICRF, 0.02 arcsec away");
  m.add("utc", &Form::utc, Text{}, "epoch for ICRF, ISO 8601; left out: the Sun's");
  m.add("et_s", &Form::et_s, Number{kAnyNumber, "s"}, std::string(kEtMeaning));
  m.add("position_m", &Form::position_m, Vector{kCoordinate_m, "m"}, "Cartesian position");
  m.add("geodetic", &Form::geodetic, Object{geodetic_members()}, "position in MOON_ME; not with another `frame`");
  m.exactly_one({"position_m", "geodetic"});
  m.excludes("utc", {"et_s"});
}

// Returns moon_me_from_frame, the rotation of vectors of the form's frame into MOON_ME. ICRF without an epoch of its
// own uses the Sun's, plus the time of a pose at a time (ReadContext::pose_time_s).
std::optional<Mat3> resolve_frame(const JsonReader& in, const PositionForm& form, const ReadContext& context) {
  // An epoch ("utc" or "et_s") orients ICRF against the Moon. With a body-fixed frame, which turns with the Moon, it
  // has no meaning: reject it, since a client that gives one probably meant ICRF. An empty `frame` is ICRF (PoseFrame).
  const bool has_epoch = form.utc || form.et_s;
  if (form.frame) {
    if (!has_epoch) return engine::moon_me_from(*form.frame);
    in.fail(form.member(), "goes with \"frame\": \"ICRF\": the Moon's frames turn with it");
  } else if (!has_epoch && context.sun_utc.empty()) {
    in.fail("frame", "ICRF needs an epoch: \"utc\" or \"et_s\" here, or of the Sun");
  } else {
    try {
      return has_epoch ? engine::moon_me_from_icrf(form.as_utc())
                       : engine::moon_me_from_icrf(context.sun_utc, context.pose_time_s);
    } catch (const ImpossibleRequest& e) {
      in.fail(form.member(), e.what());
    }
  }
  return std::nullopt;
}

// Returns the position in MOON_ME; reports a frame that does not fit, and coordinates out of range.
std::optional<Vec3> resolve_position(const JsonReader& in, const PositionForm& form, const Mat3& moon_me_from_frame) {
  if (form.geodetic && form.frame != engine::BodyFrame::moon_me) {
    // Reject rather than guess: PA and ME differ by 860 m, and a silent mix-up would look plausible in every image.
    in.fail("geodetic", "is MOON_ME always; with another frame give position_m");
    return std::nullopt;
  }
  const Vec3 position_m = form.position_m ? Vec3(moon_me_from_frame * *form.position_m) : to_cartesian(*form.geodetic);
  // Check the range once more: rotating the position or adding the Moon's radius can leave it, and then the resolved
  // request would not be a valid request.
  if (position_m.is_within(kCoordinate_m.max)) return position_m;
  in.fail(form.position_m ? "position_m" : "geodetic",
          fmt::format("lies more than {} m from the Moon's centre along an axis of MOON_ME", kCoordinate_m.max));
  return std::nullopt;
}

constexpr const char* kAboveGroundMeaning =
    "above the terrain at this place, with the request's `detail`, instead of height_m; the request in the metadata "
    "has the resulting position";

// Returns the height above the sphere of a point above the ground; reports a place without ground.
std::optional<double> resolve_above_ground(const JsonReader& in, double lat_deg, double lon_deg,
                                           double height_above_ground_m, const ReadContext& context) {
  if (!context.ground_height) {
    in.fail("height_above_ground_m", "is unknown here, where no terrain is at hand: give height_m");
    return std::nullopt;
  }
  const double ground_m = context.ground_height(lat_deg, lon_deg);
  if (!std::isnan(ground_m)) return ground_m + height_above_ground_m;
  in.fail("height_above_ground_m",
          fmt::format("no data at {:.9g}, {:.9g}: the DEM has no ground there; give height_m", lat_deg, lon_deg));
  return std::nullopt;
}

std::optional<Geographic> resolve_geodetic(const JsonReader& in, const GeodeticForm& form, const ReadContext& context) {
  const std::optional<double> height_m =
      form.height_m ? form.height_m
                    : resolve_above_ground(in, form.lat_deg, form.lon_deg, *form.height_above_ground_m, context);
  if (!height_m) return std::nullopt;
  return Geographic{form.lat_deg, form.lon_deg, *height_m};
}

// --- cameras

const Members<LookAt>& look_at_members() {
  static const auto table = make_table<Members<LookAt>>(
      "LookAt", "Boresight through a point, which then appears at (cx, cy). Always MOON_ME, whatever `frame` is.",
      [](auto& m) {
        add_latitude_and_longitude(m);
        m.add("height_m", &LookAt::height_m, Number{kHeight_m, "m"}, "above the sphere of 1 737 400 m");
        m.add("height_above_ground_m", &LookAt::height_above_ground_m, Number{kHeight_m, "m"}, kAboveGroundMeaning);
        m.excludes("height_m", {"height_above_ground_m"});
        m.add("up", &LookAt::up, Up{},
              "up in the image: the Moon's north (local north where the boresight is vertical); the zenith, the local "
              "vertical at the camera, so that the horizon is level; or a MOON_ME vector");
      });
  return *table;
}

const Members<Nadir>& nadir_members() {
  static const auto table = make_table<Members<Nadir>>(
      "Nadir", "Boresight to the Moon's centre, or tilted from there about a level axis.", [](auto& m) {
        m.add("up_azimuth_deg", &Nadir::up_azimuth_deg, Number{kAzimuth_deg, "deg"},
              "compass azimuth, clockwise from north, of the image's up direction (-y) before the tilt");
        m.add("tilt_deg", &Nadir::tilt_deg, Number{{0, 180}, "deg"},
              "angle between boresight and nadir: 90 looks along the level, 180 to the zenith");
        m.add("azimuth_deg", &Nadir::azimuth_deg, Number{kAzimuth_deg, "deg"},
              "compass azimuth toward which `tilt_deg` tilts the boresight; left out: `up_azimuth_deg`, so that the "
              "horizon is level and up in the image");
        m.needs("azimuth_deg", {"tilt_deg"});
      });
  return *table;
}

// Returns the attitude with the boresight from the camera to the point of the form.
std::optional<Quat> look_at(const JsonReader& in, const LookAt& form, const Vec3& position_m,
                            const ReadContext& context) {
  double height_m = form.height_m;
  if (form.height_above_ground_m) {
    const auto resolved = resolve_above_ground(in, form.lat_deg, form.lon_deg, *form.height_above_ground_m, context);
    if (!resolved) return std::nullopt;
    height_m = *resolved;
  }
  const Vec3 target_m = to_cartesian({form.lat_deg, form.lon_deg, height_m});
  const std::optional<Vec3> boresight = direction_of(target_m - position_m);
  if (!boresight) {
    in.fail("is where the camera is: not a direction");
    return std::nullopt;
  }
  // Empty if the up direction is along the boresight, which leaves the roll undefined.
  const auto attitude = [&]() -> std::optional<Quat> {
    switch (form.up.kind) {
      case ImageUp::Kind::direction:
        return camera_along(*boresight, form.up.direction);
      case ImageUp::Kind::zenith:
        return camera_along(*boresight, position_m.stable_normalized());
      case ImageUp::Kind::north:
        break;
    }
    return camera_north_up(*boresight, local_axes(form.lat_deg, form.lon_deg).north);
  }();
  if (attitude) return attitude;
  in.fail("up", form.up.kind == ImageUp::Kind::direction ? "is along the boresight"
                : form.up.kind == ImageUp::Kind::zenith
                    ? "\"zenith\" is along the boresight: give \"north\" or a vector"
                    : "\"north\" is along the boresight: give a vector");
  return std::nullopt;
}

// Returns the local axes at a position; empty, and reported, at the Moon's centre. At a pole only `geodetic` has a
// longitude: axes derived from position_m would lose it.
std::optional<EastNorthUp> axes_at(const JsonReader& in, const PositionForm& form, const Vec3& position_m) {
  if (form.geodetic) return local_axes(form.geodetic->lat_deg, form.geodetic->lon_deg);
  if (position_m.norm() > 0) return local_axes(position_m);
  in.fail("has no direction from the Moon's centre");
  return std::nullopt;
}

// Returns the attitude with the boresight to the Moon's centre and the form's azimuth up in the image, then tilted.
std::optional<Quat> look_down(const JsonReader& in, const PoseForm& pose, const Vec3& position_m) {
  const auto local = axes_at(in, pose, position_m);
  if (!local) return std::nullopt;
  // Returns the level direction at an azimuth.
  const auto level = [&](double azimuth_deg) -> Vec3 {
    const double azimuth_rad = azimuth_deg * kRadiansPerDegree;
    return std::cos(azimuth_rad) * local->north + std::sin(azimuth_rad) * local->east;
  };
  const Nadir& nadir = *pose.nadir;
  Vec3 boresight = -local->up, up = level(nadir.up_azimuth_deg);
  if (nadir.tilt_deg != 0) {
    const Vec3 toward = level(nadir.azimuth_deg.value_or(nadir.up_azimuth_deg));
    const AngleAxis tilt(nadir.tilt_deg * kRadiansPerDegree, boresight.cross(toward));
    boresight = tilt * boresight;
    up = tilt * up;
  }
  // camera_along() never returns empty here: `up` is perpendicular to the boresight.
  return camera_along(boresight, up).value_or(Quat::identity());
}

// Returns the attitude as given, in the client's axes and frame, from any of the four rotations.
Quat camera_from_frame(const PoseForm& form) {
  if (form.camera_from_moon) return *form.camera_from_moon;
  if (form.moon_from_camera) return form.moon_from_camera->conjugate();
  return quaternion_of(form.camera_from_moon_matrix ? *form.camera_from_moon_matrix
                                                    : Mat3(form.moon_from_camera_matrix->transpose()));
}

// Returns the pose in MOON_ME and OpenCV axes: frame first, then position, then the attitude, which may depend on both.
std::optional<engine::Pose> resolve_pose(const JsonReader& in, const PoseForm& form, const ReadContext& context) {
  const std::optional<Mat3> moon_me_from_frame = resolve_frame(in, form, context);
  if (!moon_me_from_frame) return std::nullopt;
  const std::optional<Vec3> position_m = resolve_position(in, form, *moon_me_from_frame);
  if (!position_m) return std::nullopt;
  std::optional<Quat> attitude;
  if (form.look_at) {
    attitude = look_at(in.at("look_at"), *form.look_at, *position_m, context);
  } else if (form.nadir) {
    attitude = look_down(in.at("nadir"), form, *position_m);
  } else {
    attitude = resolve_quaternion(camera_from_frame(form), form.axes, *moon_me_from_frame);
  }
  if (!attitude) return std::nullopt;
  return engine::Pose{*position_m, canonical(*attitude)};
}

// Returns the form in which a pose is written: position_m and camera_from_moon.
PoseForm form_of(const engine::Pose& pose) {
  PoseForm form;
  form.position_m = pose.position_m;
  form.camera_from_moon = pose.camera_from_moon;
  return form;
}

// --- objects

const Members<Upright>& upright_members() {
  static const auto table = make_table<Members<Upright>>(
      "Upright", "Attitude of an object whose z axis points away from the Moon's centre.", [](auto& m) {
        m.add("azimuth_deg", &Upright::azimuth_deg, Number{kAzimuth_deg, "deg"},
              "compass azimuth of its x axis, clockwise from north");
      });
  return *table;
}

// Returns moon_from_object with the z axis up and the x axis at the form's azimuth.
std::optional<Quat> upright_attitude(const JsonReader& in, const ObjectPoseForm& pose, const Vec3& position_m) {
  const auto local = axes_at(in, pose, position_m);
  if (!local) return std::nullopt;
  const double azimuth_rad = pose.upright->azimuth_deg * kRadiansPerDegree;
  const Vec3 x = std::cos(azimuth_rad) * local->north + std::sin(azimuth_rad) * local->east;
  return Quat(Mat3(x, local->up.cross(x), local->up)).normalized();
}

std::optional<ObjectPose> resolve_object_pose(const JsonReader& in, const ObjectPoseForm& form,
                                              const ReadContext& context) {
  const std::optional<Mat3> moon_me_from_frame = resolve_frame(in, form, context);
  if (!moon_me_from_frame) return std::nullopt;
  const std::optional<Vec3> position_m = resolve_position(in, form, *moon_me_from_frame);
  if (!position_m) return std::nullopt;
  if (form.upright) {
    const auto attitude = upright_attitude(in.at("upright"), form, *position_m);
    if (!attitude) return std::nullopt;
    return ObjectPose{*position_m, canonical(*attitude)};
  }
  // The attitude is relative to the form's frame, "moon" in the members' names; rotate it into MOON_ME.
  const Quat frame_from_object = form.moon_from_object ? *form.moon_from_object : form.object_from_moon->conjugate();
  return ObjectPose{*position_m, canonical(Quat(*moon_me_from_frame) * frame_from_object)};
}

ObjectPoseForm form_of(const ObjectPose& pose) {
  ObjectPoseForm form;
  form.position_m = pose.position_m;
  form.moon_from_object = pose.moon_from_object;
  return form;
}

}  // namespace

std::string EpochForm::as_utc() const { return et_s ? engine::utc_of_et(*et_s) : utc.value_or(std::string()); }

Quat canonical(Quat q) {
  if (!is_unit(q)) q = q.normalized();
  for (const double component : {q.w, q.x, q.y, q.z}) {
    if (component == 0) continue;
    if (component < 0) q = {-q.w, -q.x, -q.y, -q.z};
    break;
  }
  return {q.w + 0.0, q.x + 0.0, q.y + 0.0, q.z + 0.0};  // turns -0 into 0
}

const Members<Geographic>& place_members() {
  static const auto table =
      make_table<Members<Geographic>>("Place", "A place on the Moon.", [](auto& m) { add_latitude_and_longitude(m); });
  return *table;
}

const Members<GeodeticForm, Geographic>& geodetic_members() {
  static const auto table = make_table<
      Members<GeodeticForm, Geographic>>("Geodetic", "A place and its height.", [](auto& m) {
    add_latitude_and_longitude(m);
    m.add("height_m", &GeodeticForm::height_m, Number{kHeight_m, "m"}, "above the sphere of 1 737 400 m");
    m.add("height_above_ground_m", &GeodeticForm::height_above_ground_m, Number{kHeight_m, "m"}, kAboveGroundMeaning);
    m.exactly_one({"height_m", "height_above_ground_m"});
    m.resolve(resolve_geodetic);
    m.unresolve([](const Geographic& geodetic) {
      return GeodeticForm{geodetic.lat_deg, geodetic.lon_deg, geodetic.height_m, std::nullopt};
    });
  });
  return *table;
}

const Members<PoseForm, engine::Pose>& pose_members() {
  static const auto table = make_table<Members<PoseForm, engine::Pose>>(
      "Pose",
      "Position (`position_m` or `geodetic`) and attitude (one of `camera_from_moon`, `moon_from_camera`, `look_at`, "
      "`nadir`, or a matrix) of the camera. `frame` applies to `position_m`, the quaternions and the matrices; "
      "latitudes, longitudes and `look_at.up` are always MOON_ME, so `geodetic` cannot be combined with other frames. "
      "PA and ME differ by about 860 m. ICRF is rotated by the model of the Moon's rotation that the Sun's `utc` uses "
      "(WGCCRE 2009), accurate to 0.01 degrees: at most 300 m on the ground.",
      [](auto& m) {
        add_position(m);
        m.add("camera_from_moon", &PoseForm::camera_from_moon, Object{quaternion_members()},
              "unit quaternion that rotates vectors of `frame` into camera axes");
        m.add("moon_from_camera", &PoseForm::moon_from_camera, Object{quaternion_members()},
              "unit quaternion that rotates camera axes into `frame`");
        m.add("camera_from_moon_matrix", &PoseForm::camera_from_moon_matrix, RotationMatrix{},
              "rotation matrix from `frame` to camera axes, row by row: the rows are the camera's axes in `frame`; "
              "orthonormal within 1e-6");
        m.add("moon_from_camera_matrix", &PoseForm::moon_from_camera_matrix, RotationMatrix{},
              "rotation matrix from camera axes to `frame`, row by row: the columns are the camera's axes in `frame`; "
              "orthonormal within 1e-6");
        m.add("look_at", &PoseForm::look_at, Object{look_at_members()}, "boresight through a point");
        m.add("nadir", &PoseForm::nadir, Object{nadir_members()}, "boresight to the Moon's centre");
        m.add("axes", &PoseForm::axes, Word{kCameraAxes},
              "camera axes of quaternions and matrices: opencv +x right, +y down, +z boresight; opengl +x right, +y "
              "up, -z boresight. Ignored for look_at and nadir");
        m.exactly_one({"camera_from_moon", "moon_from_camera", "camera_from_moon_matrix", "moon_from_camera_matrix",
                       "look_at", "nadir"});
        m.resolve(resolve_pose);
        m.unresolve([](const engine::Pose& pose) { return form_of(pose); });
      });
  return *table;
}

const Members<ObjectPoseForm, ObjectPose>& object_pose_members() {
  static const auto table = make_table<Members<ObjectPoseForm, ObjectPose>>(
      "ObjectPose", "Position of an object's origin and attitude of its axes, as in its file.", [](auto& m) {
        add_position(m);
        m.add("moon_from_object", &ObjectPoseForm::moon_from_object, Object{quaternion_members()},
              "unit quaternion that rotates vectors of the object's axes into `frame`");
        m.add("object_from_moon", &ObjectPoseForm::object_from_moon, Object{quaternion_members()},
              "unit quaternion that rotates vectors of `frame` into the object's axes");
        m.add("upright", &ObjectPoseForm::upright, Object{upright_members()},
              "the object's z axis is the local vertical");
        m.exactly_one({"moon_from_object", "object_from_moon", "upright"});
        m.resolve(resolve_object_pose);
        m.unresolve([](const ObjectPose& pose) { return form_of(pose); });
      });
  return *table;
}

}  // namespace selenograph::api
