#include "api/requests/cameras.h"

#include <fmt/format.h>

#include <string_view>

#include "api/message/problem.h"
#include "dem/base/names.h"

namespace selenograph::api {
bool has_cameras(const Json& body) { return body.is_object() && body.contains("cameras"); }

std::vector<CameraBody> split_cameras(const Json& body) {
  Findings findings;
  const JsonReader in(body, findings), cameras = in.at("cameras");
  const Json& members_by_name = cameras.value();
  if (!members_by_name.is_object() || members_by_name.empty() || members_by_name.size() > kMaxCameras) {
    cameras.fail(fmt::format("must be an object of 1 to {} cameras by their names", kMaxCameras));
    findings.throw_if_any();
  }
  constexpr std::string_view kRequestOnlyMembers[] = {"cameras", "echo"};
  std::vector<CameraBody> requests;
  for (const auto& [name, camera_members] : members_by_name.items()) {
    // The name becomes a folder in the answer's .npz.
    if (name.size() > kMaxCameraNameLength || !dem::consists_of(name, "_-")) {
      cameras.fail(fmt::format("names have 1 to {} letters, digits, '_' and '-'", kMaxCameraNameLength));
      continue;
    }
    const JsonReader camera = cameras.at(name);
    if (!camera_members.is_object()) {
      camera.fail("must be an object");
      continue;
    }
    for (const std::string_view member : kRequestOnlyMembers)
      if (camera.has(member)) camera.fail(member, "is a member of the request, not of a camera");
    Json merged = body;
    merged.erase("cameras");
    for (const auto& [member, value] : camera_members.items()) merged[member] = value;
    requests.push_back({name, std::move(merged)});
  }
  findings.throw_if_any();
  return requests;
}

void with_pointers_of(const Json& body, const std::string& camera, const std::function<void()>& work) {
  try {
    work();
  } catch (const RequestError& e) {
    const Json& camera_members = body.at("cameras").at(camera);
    std::vector<Finding> findings = e.findings();
    for (Finding& f : findings) {
      // Leave pointers to shared members as they are. A member that neither object has, such as a missing pose, is the
      // camera's.
      const std::size_t end = f.pointer.find('/', 1);
      const bool is_of_member = !f.pointer.empty();  // else the fault is that of the whole request
      const std::string member = is_of_member ? f.pointer.substr(1, end - 1) : std::string();
      const bool is_shared = is_of_member && !camera_members.contains(member) && body.contains(member);
      if (!is_shared) f.pointer.insert(0, "/cameras/" + camera);
    }
    throw RequestError(e.code(), fmt::format("camera \"{}\": {}", camera, e.what()), findings);
  }
}

}  // namespace selenograph::api
