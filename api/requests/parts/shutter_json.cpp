// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/shutter_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "api/requests/parts/sun_json.h"
#include "engine/camera/pose_track.h"

namespace selenograph::api {
namespace {

using engine::PoseAtTime;
using engine::Shutter;

constexpr Range kPoseTime_s{-1e6, 1e6};

// Returns true if a pose's "frame" is one of the names of ICRF, whose frame in the table is empty.
bool is_in_icrf(const Json& pose) {
  const std::string word = pose.value("frame", std::string());
  return std::any_of(std::begin(kPoseFrames), std::end(kPoseFrames),
                     [&](const auto& frame) { return !frame.second && frame.first == word; });
}

}  // namespace

const Members<PoseAtTime>& pose_at_time_members() {
  static const auto table =
      make_table<Members<PoseAtTime>>("PoseAtTime", "A pose of the camera at a time.", [](auto& m) {
        m.add("time_s", &PoseAtTime::time_s, Number{kPoseTime_s, "s"}, "time from the exposure of row 0").required();
        m.add("pose", &PoseAtTime::pose, Object{pose_members()},
              "position and attitude of the camera at that time; in ICRF without an epoch: that of the Sun plus time_s")
            .required();
      });
  return *table;
}

std::optional<PoseAtTime> TimedPose::read(const JsonReader& in, const ReadContext& context) const {
  ReadContext pose_context = context;
  const Json time = in.has("time_s") ? in.at("time_s").value() : Json();
  if (time.is_number() && kPoseTime_s.contains(time.get<double>())) pose_context.pose_time_s = time.get<double>();
  return Object::read(in, pose_context);
}

void check_times(const JsonReader& in, const std::vector<PoseAtTime>& poses) {
  for (std::size_t i = 1; i < poses.size(); ++i)
    if (!(poses[i].time_s > poses[i - 1].time_s)) return in.fail("poses", "their times must rise");
}

const Members<Shutter>& shutter_members() {
  static const auto table = make_table<Members<Shutter>>(
      "Shutter",
      "The rows are exposed one after the other, from the top: row y at the time y * line_time_s. Each row is seen "
      "from the pose at its time. The camera moves from `pose`, which is that of row 0, at constant "
      "rates (`velocity_m_s`, `angular_rate_deg_s` or both; one that is left out is zero), or through `poses`, which "
      "replace `pose`.",
      [](auto& m) {
        m.add("line_time_s", &Shutter::line_time_s, Number{{1e-9, 1e4}, "s"},
              "time between the exposures of consecutive rows")
            .required();
        m.any_of({"velocity_m_s", "angular_rate_deg_s", "poses"});
        add_motion(
            m, "velocity of the camera, MOON_ME",
            "at increasing times, the first not after row 0, the last not before the last row. Positions are "
            "interpolated by cubic Hermite polynomials (each pose's velocity is that of the parabola through it and "
            "its neighbours), attitudes by slerp, the shorter way");
        m.add("pushbroom", &Shutter::pushbroom, Flag{},
              "true: a line camera; all rows look along the camera's row through the principal point (cy). False: a "
              "rolling shutter; each row looks along its own");
      });
  return *table;
}

void check_pose(const JsonReader& in, const engine::Camera& camera, const std::optional<Shutter>& shutter,
                engine::Pose& pose) {
  // Look into the JSON: a shutter with faults has no value, and its poses must not be reported as missing.
  const bool has_poses = in.has("shutter") && in.at("shutter").value().is_object() && in.at("shutter").has("poses");
  if (!has_poses && !in.has("pose")) in.fail("pose", "is required");
  if (has_poses && in.has("pose"))
    in.fail("pose", "\"pose\" cannot be combined with \"shutter.poses\", which take its place");
  if (!shutter || shutter->poses.empty()) return;
  const double last_s = shutter->time_s(camera.height - 1);
  if (shutter->poses.front().time_s > 0)
    in.at("shutter").fail("poses", "the first is later than row 0, whose time is 0");
  if (shutter->poses.back().time_s < last_s)
    in.at("shutter").fail("poses", fmt::format("the last is earlier than the last row, whose time is {:g} s", last_s));
  if (in.faults() > 0) return;
  pose = engine::PoseTrack(pose, *shutter).at(0);
  pose.camera_from_moon = canonical(pose.camera_from_moon);
  // Check the result's range: Hermite polynomials overshoot if the poses' times are much more uneven than their
  // positions.
  if (!pose.position_m.is_within(kCoordinate_m.max))
    in.at("shutter").fail("poses", fmt::format("take row 0 more than {} m from the Moon's centre", kCoordinate_m.max));
}

double icrf_lag_s(const JsonReader& in, const engine::Camera& camera, const std::optional<Shutter>& shutter,
                  const std::string& utc, const std::string& sky_utc) {
  constexpr double kSecondsPerDay = 86400;
  const engine::JulianDate sky = engine::tt_at(sky_utc);
  double largest_lag_s = 0;
  // Compares the epoch at which a row is exposed with the sky's. `row_s` is the time of the exposed row nearest to the
  // pose's time `time_s`. A pose without an epoch of its own has the request's `utc`, which belongs to time 0; an epoch
  // of its own belongs to `time_s`.
  const auto add_lag_of = [&](const Json& pose, double time_s, double row_s) {
    if (!is_in_icrf(pose)) return;
    const std::string pose_utc = utc_of(pose);
    const engine::JulianDate epoch = engine::tt_at(pose_utc.empty() ? utc : pose_utc);
    const double lag_s = ((epoch.day - sky.day) + (epoch.fraction - sky.fraction)) * kSecondsPerDay +
                         (pose_utc.empty() ? row_s : row_s - time_s);
    if (std::abs(lag_s) > std::abs(largest_lag_s)) largest_lag_s = lag_s;
  };
  if (in.has("pose")) add_lag_of(in.at("pose").value(), 0, 0);
  if (!shutter || shutter->poses.empty()) return largest_lag_s;
  const Json& poses = in.at("shutter").at("poses").value();
  const double last_s = shutter->time_s(camera.height - 1);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double time_s = shutter->poses[i].time_s;
    add_lag_of(poses[i]["pose"], time_s, std::clamp(time_s, 0.0, last_s));
  }
  return largest_lag_s;
}

OrderedJson pose_condition(const Limits&) {
  const OrderedJson poses{{"required", OrderedJson::array({"shutter"})},
                          {"properties", {{"shutter", {{"required", OrderedJson::array({"poses"})}}}}}};
  return {{"oneOf", OrderedJson::array({{{"required", OrderedJson::array({"pose"})}}, poses})}};
}

}  // namespace selenograph::api
