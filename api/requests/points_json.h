// Requests for rays, landmarks and heights. Positions and directions are MOON_ME.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "api/encode/read_npz.h"
#include "api/requests/parts/camera_json.h"
#include "api/requests/parts/detail_json.h"
#include "api/requests/parts/map_error_json.h"
#include "api/requests/parts/objects_json.h"
#include "api/requests/parts/pose_json.h"
#include "api/requests/parts/scenery_json.h"
#include "api/requests/parts/sun_json.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/camera.h"
#include "engine/frame/pose.h"
#include "engine/frame/shutter.h"
#include "engine/frame/sun.h"
#include "engine/rays/ray_queries.h"

namespace selenograph::api {

// Sun, ground and occluders common to rays and landmarks.
struct PointScenery : SceneryQuery {
  engine::FrameRequest request;  // its Sun, ground, band, detail and indirect light
  std::vector<PlacedObject> objects;
  engine::FrameRequest& scenery() { return request; }
  const engine::FrameRequest& scenery() const { return request; }
  std::optional<engine::Sun> sun() const { return sun_given ? std::optional(request.sun) : std::nullopt; }
};
// `shape` is the shape of the arrays with the rays or points, without the last dimension; empty for JSON lists.
struct RaysQuery : PointScenery {
  std::vector<engine::Ray> rays;
  std::vector<std::size_t> shape{};
  std::optional<MapErrorQuery> map_error{};
  double min_post_spacing_m = 0;
};
// `points`: the landmarks to project into the camera's image.
struct ProjectQuery : PointScenery {
  engine::Camera camera;
  engine::Pose pose;
  std::optional<engine::Shutter> shutter;
  std::vector<engine::LandmarkQuery> points;
  std::vector<std::size_t> shape{};
};
// A resolved request for terrain heights.
struct HeightsQuery {
  std::vector<Geographic> points;
  Named<dem::Detail> detail{};  // null: none
  std::optional<MapErrorQuery> map_error{};
};

const Members<RaysQuery>& rays_members();
const Members<ProjectQuery>& project_members();
const Members<HeightsQuery>& heights_members();

// Parse requests. Throw RequestError("invalid_request") with the faults found. Arrays, if there are any, replace lists:
// - `rays`: `origin_m` and `direction` (..., 3); either may have a single row that is used with all rows of the other;
// - `points`: (..., 2) or (..., 3) with lat_deg, lon_deg and height_m, where NaN means on the terrain.
RaysQuery read_rays(const Json& body, const Limits& limits, const Assets& assets = Assets(), const StopToken& stop = {},
                    const NpzArrays& arrays = {}, const GroundHeights& ground = {});
ProjectQuery read_project(const Json& body, const Limits& limits, const Assets& assets = Assets(),
                          const StopToken& stop = {}, const NpzArrays& arrays = {}, const GroundHeights& ground = {});
HeightsQuery read_heights(const Json& body, const Limits& limits, const Assets& assets = Assets(),
                          const StopToken& stop = {});
// Parses the query string of GET /v1/height. Faults have the parameters' names as pointers: "/lat_deg".
Geographic read_height_query(const std::multimap<std::string, std::string>& query);

}  // namespace selenograph::api
