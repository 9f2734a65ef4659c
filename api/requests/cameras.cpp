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
  const Json& given = cameras.value();
  if (!given.is_object() || given.empty() || given.size() > kMostCameras) {
    cameras.fail(fmt::format("must be an object of 1 to {} cameras by their names", kMostCameras));
    findings.throw_if_any();
  }
  constexpr std::string_view kOfAll[] = {"cameras", "echo"};
  std::vector<CameraBody> out;
  for (const auto& [name, own] : given.items()) {
    // It is a folder's in an .npz.
    if (name.size() > kLongestCameraName || !dem::consists_of(name, "_-")) {
      cameras.fail(fmt::format("names have 1 to {} letters, digits, '_' and '-'", kLongestCameraName));
      continue;
    }
    const JsonReader one = cameras.at(name);
    if (!own.is_object()) {
      one.fail("must be an object");
      continue;
    }
    for (const std::string_view member : kOfAll)
      if (one.has(member)) one.fail(member, "is a member of the request, not of a camera");
    Json merged = body;
    merged.erase("cameras");
    for (const auto& [member, value] : own.items()) merged[member] = value;
    out.push_back({name, std::move(merged)});
  }
  findings.throw_if_any();
  return out;
}

void with_pointers_of(const Json& body, const std::string& camera, const std::function<void()>& work) {
  try {
    work();
  } catch (const RequestError& e) {
    const Json& own = body.at("cameras").at(camera);
    std::vector<Finding> findings = e.findings();
    for (Finding& f : findings) {
      const std::size_t end = f.pointer.find('/', 1);
      const std::string first = f.pointer.substr(0, end);
      const bool of_all = !first.empty() && !own.contains(first.substr(1)) && body.contains(first.substr(1));
      if (!of_all) f.pointer.insert(0, "/cameras/" + camera);
    }
    throw RequestError(e.code(), fmt::format("camera \"{}\": {}", camera, e.what()), findings);
  }
}

}  // namespace selenograph::api
