// Splits a request for several cameras at one instant into one request per camera:
//
//   {"sun": S, "camera": C, "cameras": {"left": {"pose": L}, "right": {"pose": R, "camera": D}}}
//      -> left:  {"sun": S, "camera": C, "pose": L}
//      -> right: {"sun": S, "camera": D, "pose": R}
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "api/json/json_reader.h"

namespace selenograph::api {

// One camera's share of a request with several.
struct CameraBody {
  std::string name;
  Json body;  // request for this camera's frame: the shared members, overridden by the camera's
};

inline constexpr std::size_t kMaxCameras = 16, kMaxCameraNameLength = 64;

// Returns true for a request with the member "cameras".
bool has_cameras(const Json& body);

// Returns one request per camera. Throws RequestError("invalid_request") with all faults of the cameras' names and
// members.
std::vector<CameraBody> split_cameras(const Json& body);

// Calls work() for one camera and rewrites the JSON Pointers of its RequestError, which refer to the split request, so
// that they refer to `body`: a fault in a member overridden by the camera is below "/cameras/NAME".
void with_pointers_of(const Json& body, const std::string& camera, const std::function<void()>& work);

}  // namespace selenograph::api
