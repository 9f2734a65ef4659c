// A request for a frame: JSON <-> engine::FrameRequest, as the contract says. The way from untrusted to resolved
// values.
#pragma once

#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "api/assets/assets.h"
#include "api/json/json_reader.h"
#include "api/requests/parts/camera_json.h"
#include "api/requests/parts/objects_json.h"
#include "api/requests/parts/pose_json.h"
#include "api/requests/parts/scenery_json.h"
#include "engine/frame/request.h"

namespace selenograph::api {

inline constexpr std::pair<std::string_view, engine::Visibility> kVisibilities[] = {
    {"auto", engine::Visibility::automatic},
    {"zbuffer", engine::Visibility::zbuffer},
    {"raytrace", engine::Visibility::raytrace}};
std::string_view visibility_name(engine::Visibility visibility);

struct FrameQuery : SceneryQuery {
  engine::FrameRequest request;
  // Time for which the accuracy is to be chosen; empty: `request.accuracy` was given or is the default.
  std::optional<double> budget_ms;
  std::string atmosphere_name;  // that request.atmosphere was found by
  std::vector<ObjectQuery> objects;
  std::vector<engine::Pose> ahead;  // that the client expects next; changes nothing of this frame
  std::string echo;                 // given back in a header: compact JSON in ASCII; empty: none

  engine::FrameRequest& look() { return request; }
  const engine::FrameRequest& look() const { return request; }
};
const Members<FrameQuery>& frame_members();

// Throws RequestError("invalid_request") with every fault found, Cancelled when `stop` says so: meshes take long to
// read.
FrameQuery read_frame(const Json& body, const Limits& limits, const Assets& assets = Assets(),
                      const StopToken& stop = {});

// The request as it was understood: pose in MOON_ME and OpenCV axes, intrinsics in pixels, a Sun vector. A valid
// request itself: sent back to the service it gives the same frame. Same meaning, same text, so it is also what ETag is
// made from.
nlohmann::ordered_json resolved_json(const FrameQuery& query);

}  // namespace selenograph::api
