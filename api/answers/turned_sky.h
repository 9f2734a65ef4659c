// Warns of requests whose sky and poses in ICRF have different epochs. The Moon rotates between the epochs, and the
// pose is converted to MOON_ME at its own: the sky then appears rotated against the pose's inertial attitude.
#pragma once

#include <nlohmann/json.hpp>

#include "engine/frame/request.h"

namespace selenograph::api {

// Returns the angle, in degrees, by which the sky is rotated against poses in ICRF; 0 if no sky is shown or the
// rotation is less than a twentieth of a pixel. `icrf_lag_s` is that of a FrameQuery or a SkyQuery.
double sky_turned_deg(const engine::FrameRequest& request, double icrf_lag_s);

// Appends a warning if that angle is not 0.
void warn_of_turned_sky(const engine::FrameRequest& request, double icrf_lag_s, nlohmann::ordered_json& warnings);

}  // namespace selenograph::api
