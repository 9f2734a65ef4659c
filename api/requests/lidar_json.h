// Requests for a lidar's scan.
#pragma once

#include <string>
#include <vector>

#include "api/encode/read_npz.h"
#include "api/requests/parts/objects_json.h"
#include "api/requests/parts/scenery_json.h"
#include "api/requests/parts/shutter_json.h"
#include "engine/frame/lidar.h"

namespace selenograph::api {

struct LidarQuery : SceneryQuery {
  engine::LidarRequest request;
  std::vector<PlacedObject> objects;
  std::size_t beams = 0;
  engine::FrameRequest& look() { return request.scenery; }
  const engine::FrameRequest& look() const { return request.scenery; }
};

const Members<LidarQuery>& lidar_members();

// `arrays`: direction (n, 3) and time_s (n, or one for all) in the place of `pulses`; empty: none. Throws RequestError
// "invalid_request" with the faults found.
LidarQuery read_lidar(const Json& body, const NpzArrays& arrays, const Limits& limits, const Assets& assets,
                      const StopToken& stop);

// Rows and columns of a pattern whose beams are in the order of an image, repeats first; else their number.
std::vector<std::size_t> shape_of(const LidarQuery& query);

}  // namespace selenograph::api
