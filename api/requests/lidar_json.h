// Requests for a lidar's scan.
#pragma once

#include <string>
#include <vector>

#include "api/encode/read_npz.h"
#include "api/requests/parts/objects_json.h"
#include "api/requests/parts/scenery_json.h"
#include "api/requests/parts/shutter_json.h"
#include "engine/lidar/lidar.h"

namespace selenograph::api {

// A resolved request for a scan: the engine's request, and what the engine does not know.
struct LidarQuery : SceneryQuery {
  engine::LidarRequest request;
  std::vector<PlacedObject> objects;
  std::size_t beams = 0;  // number of beams of the pulses or of the pattern
  engine::FrameRequest& scenery() { return request.scenery; }
  const engine::FrameRequest& scenery() const { return request.scenery; }
};

const Members<LidarQuery>& lidar_members();

// Parses a request. `arrays` may have direction (n, 3) and time_s (n, or one number for all), which then replace
// `pulses`. Throws RequestError("invalid_request") with the faults found.
LidarQuery read_lidar(const Json& body, const NpzArrays& arrays, const Limits& limits, const Assets& assets,
                      const StopToken& stop, const GroundHeights& ground = {});

// Returns the shape of the answer's arrays: {repeats, rows, columns} of a pattern whose beams are in the order of an
// image ({rows, columns} if it is fired once), else {beams}.
std::vector<std::size_t> shape_of(const LidarQuery& query);

}  // namespace selenograph::api
