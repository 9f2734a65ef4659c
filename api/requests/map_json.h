// Requests for maps: JSON to engine::MapRequest and back.
#pragma once

#include <optional>

#include "api/requests/frame_json.h"
#include "engine/frame/map.h"

namespace selenograph::api {

struct MapBounds {
  double south_deg = 0, north_deg = 0, west_deg = 0, east_deg = 0;
};
const Members<MapBounds>& bounds_members();
// The east edge is up to 360 degrees east of the west edge.
dem::Footprint footprint_of(const MapBounds& bounds);

// "map": projection and extent.
struct MapArea {
  dem::MapProjection projection = dem::MapProjection::equirectangular;
  std::optional<MapBounds> bounds;
  std::optional<Geographic> center;
  std::optional<double> width_m, height_m;
  double gsd_m = 0;
  std::optional<double> standard_parallel_deg;
};

struct MapQuery : SceneryQuery {
  engine::MapRequest request;
  MapArea area;

  engine::FrameRequest& look() { return request.look; }
  const engine::FrameRequest& look() const { return request.look; }
};

const Members<MapQuery>& map_members();
// Throws RequestError("invalid_request") with every fault found.
MapQuery read_map(const Json& body, const Limits& limits, const Assets& assets = Assets(), const StopToken& stop = {});
// The resolved request, which is a valid request.
OrderedJson resolved_json(const MapQuery& query);

}  // namespace selenograph::api
