// A request for several cameras at one instant: the frames that it is made of.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "api/json/json_reader.h"

namespace selenograph::api {

struct CameraBody {
  std::string name;
  Json body;  // of a frame of its own: the request's members, but those that the camera has itself
};

inline constexpr std::size_t kMostCameras = 16, kLongestCameraName = 64;

// Whether it is one: has "cameras".
bool has_cameras(const Json& body);

// Throws RequestError("invalid_request") with every fault found of the names and of what may be in a camera.
std::vector<CameraBody> split_cameras(const Json& body);

// Calls work() and turns the pointers of what it refuses into those of the request: of members that the camera has
// itself, below "/cameras/NAME".
void with_pointers_of(const Json& body, const std::string& camera, const std::function<void()>& work);

}  // namespace selenograph::api
