// "camera_preset": a camera, its band and its sensor from the assets folder. Frames and the sky share it.
#pragma once

#include <optional>
#include <string>

#include "api/schema/members.h"

namespace selenograph::api {

inline constexpr const char* kOfCameraPreset =
    "name of cameras/NAME.json in the operator's assets folder: its camera and band if the request has none, and its "
    "sensor; the request's members override it";

// The request with the preset's members where it has none of its own; of the sensor, member by member. Empty: it names
// no preset. Throws RequestError: "invalid_request" for an unknown name, "asset_error" for an unusable file.
std::optional<Json> with_camera_preset(const Json& body, const ReadContext& context);

// For the request's row: it has no preset by the time that it is read, but what the preset stands for.
template <typename Query>
auto camera_preset_field() {
  return Property{[](const Query&) { return std::optional<std::string>(); }, [](Query&, const std::string&) {}};
}

}  // namespace selenograph::api
