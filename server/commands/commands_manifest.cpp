// `selenograph manifest`: a trajectory's poses as a campaign's requests.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>

#include "api/message/problem.h"
#include "api/requests/frame_json.h"
#include "server/campaign/trajectory.h"
#include "server/commands/commands.h"
#include "server/commands/output.h"
#include "server/commands/request_file.h"

namespace selenograph::server {
namespace {

namespace fs = std::filesystem;
using api::Json;

// An object from a file.
Json object_in(const std::string& path) {
  const Json json = Json::parse(read_request(path), nullptr, false);
  if (!json.is_object()) throw std::runtime_error(path + ": is no JSON object");
  return json;
}

bool is_file(const std::string& text) { return text.ends_with(".json") || fs::is_regular_file(text); }

// A preset's name; or a file: a camera, or what a preset holds.
void set_camera(Json& request, const std::string& camera) {
  if (camera.empty()) return;
  for (const char* other : {"camera", "camera_preset"}) request.erase(other);
  if (!is_file(camera)) {
    request["camera_preset"] = camera;
    return;
  }
  const Json given = object_in(camera);
  if (!given.contains("camera")) {
    request["camera"] = given;
    return;
  }
  for (const auto& [member, value] : given.items()) {
    if (member == "description") continue;
    if (member != "camera" && member != "band" && member != "sensor")
      throw std::runtime_error(
          fmt::format("{}: \"{}\" is no member of a camera's preset: camera, band, sensor", camera, member));
    if (!request.contains(member)) request[member] = value;
  }
}

// True: by the epochs.
bool set_sun(Json& request, const std::string& sun, bool epochs) {
  if (sun.empty()) return epochs && !request.contains("sun");
  if (sun == "utc") {
    if (!epochs) throw std::runtime_error("--sun utc: the trajectory has no column utc");
    return true;
  }
  const Json given = sun.starts_with("{") ? Json::parse(sun, nullptr, false) : object_in(sun);
  if (!given.is_object()) throw std::runtime_error("--sun: is no JSON object: " + sun);
  request["sun"] = given;
  return false;
}

// Poses out of range are told here, by the trajectory's line, not frame by frame.
void check_pose(const Json& request, std::size_t number, const std::string& path) {
  const Json frame{
      {"camera", {{"width", 1}, {"height", 1}, {"fov_deg", 1}}}, {"products", {"depth"}}, {"pose", request.at("pose")}};
  try {
    api::read_frame(frame, {});
  } catch (const api::RequestError& e) {
    throw std::runtime_error(fmt::format("{}: pose number {}: {}", path, number, e.what()));
  }
}

}  // namespace

void add_options(CLI::App& command, ManifestSettings& s) {
  command
      .add_option("--trajectory", s.trajectory,
                  "Columns, separated by commas: time_s or utc; x_m, y_m, z_m or lat_deg, lon_deg, height_m; "
                  "camera_from_moon_w, .._x, .._y, .._z, or moon_from_camera_w, .., or up_azimuth_deg")
      ->required()
      ->type_name("T.csv");
  command.add_option("--camera", s.camera, "A preset's name, or a file with a camera or with what a preset holds")
      ->type_name("NAME|FILE");
  command
      .add_option("--sun", s.sun,
                  "utc: of each pose's epoch (the default where there is a column utc and --base has no Sun); or the "
                  "request's \"sun\", as JSON or in a file")
      ->type_name("utc|JSON|FILE");
  command.add_option("--base", s.base, "What all requests have in common: products, surface, accuracy, sensor, ...")
      ->type_name("REQUEST.json");
  command.add_option("--frame", s.frame, "Of positions and attitudes")
      ->check(CLI::IsMember([] {
        std::vector<std::string> names;
        for (const auto& [name, frame] : api::kPoseFrames) names.emplace_back(name);
        return names;
      }()))
      ->capture_default_str();
  command.add_option("-o,--output", s.output, "Manifest to write: a request per line")
      ->required()
      ->type_name("M.jsonl");
}

int manifest(const ManifestSettings& settings) {
  const std::vector<TimedPose> poses = read_trajectory(settings.trajectory, settings.frame);
  Json request = settings.base.empty() ? Json::object() : object_in(settings.base);
  request.erase("pose");
  request.erase("name");
  set_camera(request, settings.camera);
  const bool by_epoch = set_sun(request, settings.sun, !poses.front().utc.empty());
  if (!request.contains("camera") && !request.contains("camera_preset") && !request.contains("cameras"))
    throw std::runtime_error("--camera is needed, or a --base with a camera");
  const std::size_t width = std::max<std::size_t>(6, std::to_string(poses.size()).size());
  std::string text;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    request["name"] = fmt::format("{:0{}}", i + 1, width);
    request["pose"] = poses[i].pose;
    if (by_epoch) request["sun"] = {{"utc", poses[i].utc}};
    check_pose(request, i + 1, settings.trajectory);
    text += request.dump() + "\n";
  }
  write_whole(settings.output, text);
  fmt::print("{}: {} requests\n", settings.output, poses.size());
  return 0;
}

}  // namespace selenograph::server
