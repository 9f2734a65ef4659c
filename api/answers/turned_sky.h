// Skies of another epoch than an inertial pose has: the Moon turns meanwhile, and with it what the camera sees beyond
// it, so that requests are warned.
#pragma once

#include <nlohmann/json.hpp>

#include "engine/frame/request.h"

namespace selenograph::api {

// By how much a sky is turned from where inertial poses have it, in degrees; 0 where that is less than a twentieth of a
// pixel, or no sky is shown. `icrf_lag_s`: FrameQuery's, or SkyQuery's.
double sky_turned_deg(const engine::FrameRequest& request, double icrf_lag_s);

// Appends a warning where that isn't 0.
void warn_of_turned_sky(const engine::FrameRequest& request, double icrf_lag_s, nlohmann::ordered_json& warnings);

}  // namespace selenograph::api
