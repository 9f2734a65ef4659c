// "camera_preset": a camera, its band and its sensor from the assets folder. Frames and the sky share it.
#pragma once

#include <optional>
#include <string>

#include "api/schema/members.h"

namespace selenograph::api {

inline constexpr const char* kCameraPresetMeaning =
    "name of cameras/NAME.json in the operator's assets folder: its camera and band if the request has none, and its "
    "sensor; the request's members override it";

// Returns the request with the camera and the band of its preset where it has none, and with its sensor merged over the
// preset's (JSON merge patch); empty if it names no preset. Throws RequestError: "invalid_request" for an unknown name,
// "asset_error" for an unusable file.
std::optional<Json> with_camera_preset(const Json& body, const ReadContext& context);

}  // namespace selenograph::api
