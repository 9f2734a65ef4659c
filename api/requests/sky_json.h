// Requests for the sky in a camera's image, and their answers as JSON and NPZ.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "api/encode/negotiate.h"
#include "api/requests/parts/detail_json.h"
#include "api/requests/parts/objects_json.h"
#include "api/requests/parts/pose_json.h"
#include "api/schema/answers.h"
#include "engine/frame/request.h"

namespace selenograph::api {

// A resolved request: the engine's request, and what the engine does not know. The epoch is that of the poses in ICRF
// and, unless `sky` has its own, of the sky.
struct SkyQuery : EpochForm {
  engine::FrameRequest request;  // its camera, pose, shutter, band, sensor, sky and objects
  Named<dem::Detail> detail{};   // null: none
  double icrf_lag_s = 0;         // seconds from the sky's epoch to the poses' epoch in ICRF (icrf_lag_s())
};

const Members<SkyQuery>& sky_request_members();
// Parses a request. Throws RequestError("invalid_request") with the faults found.
SkyQuery read_sky(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop,
                  const GroundHeights& ground = {});

// Media types of the answer, in the order of the server's preference.
inline constexpr Alternative kSkyAnswers[] = {
    {"application/json", "the objects, each with its members"},
    {"application/x-npz", "the same as arrays; identifiers and kinds in meta.json"},
};

// Input of the answer for one object.
struct SkySource {
  const engine::SkyObject& object;
  const SkyQuery& query;
};
const Answer<SkySource>& sky_answer();
OrderedJson sky_json(const std::vector<engine::SkyObject>& sky, const SkyQuery& query);
std::string sky_npz(const std::vector<engine::SkyObject>& sky, const SkyQuery& query, const StopToken& stop);

}  // namespace selenograph::api
