// Requests for frames: untrusted JSON becomes an engine::FrameRequest with resolved values, which can be written as
// JSON again.
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

// Compression of the entries of an .npz.
enum class Compression { none, deflate };
inline constexpr std::pair<std::string_view, Compression> kCompressions[] = {{"none", Compression::none},
                                                                             {"deflate", Compression::deflate}};

// A resolved request for a frame: the engine's request, and what the engine does not know.
struct FrameQuery : SceneryQuery {
  engine::FrameRequest request;
  // Time budget for choosing the accuracy; empty: `request.accuracy` was given or is the default.
  std::optional<double> budget_ms;
  std::string atmosphere_name;  // name of request.atmosphere
  std::vector<ObjectQuery> objects;
  std::vector<engine::Pose> ahead;  // expected next poses, soonest first; they do not change this frame
  std::string echo;                 // returned in a header: compact ASCII JSON; empty: none
  double icrf_lag_s = 0;            // seconds from the sky's epoch to the poses' epoch in ICRF (icrf_lag_s())
  bool labels = false;              // masks are made; then `request` has craters and the product kRock
  Compression compression = Compression::none;

  engine::FrameRequest& scenery() { return request; }
  const engine::FrameRequest& scenery() const { return request; }
};
const Members<FrameQuery>& frame_members();

// Parses a request. Throws RequestError("invalid_request") with all faults found, and Cancelled when `stop` is
// requested: reading meshes takes long. `ground`: for heights above it; without it they are refused.
FrameQuery read_frame(const Json& body, const Limits& limits, const Assets& assets = Assets(),
                      const StopToken& stop = {}, const GroundHeights& ground = {});

// Returns the resolved request: pose in MOON_ME and OpenCV axes, intrinsics in pixels, a Sun vector. It is a valid
// request that gives the same frame. Requests with the same meaning have the same text, from which the ETag is made.
nlohmann::ordered_json resolved_json(const FrameQuery& query);

}  // namespace selenograph::api
