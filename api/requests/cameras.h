// Splits a request for several cameras at one instant into frames.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "api/json/json_reader.h"

namespace selenograph::api {

struct CameraBody {
  std::string name;
  Json body;  // body of its frame: the request's members, overridden by the camera's
};

inline constexpr std::size_t kMostCameras = 16, kLongestCameraName = 64;

// Whether a request has "cameras".
bool has_cameras(const Json& body);

// Throws RequestError("invalid_request") with all faults of the names and members of the cameras.
std::vector<CameraBody> split_cameras(const Json& body);

// Calls work() and converts JSON Pointers in its errors to those of the request: members overridden by the camera are
// below "/cameras/NAME".
void with_pointers_of(const Json& body, const std::string& camera, const std::function<void()>& work);

}  // namespace selenograph::api
