// A request for a map: JSON <-> engine::MapRequest.
#pragma once

#include <optional>

#include "api/requests/frame_json.h"
#include "engine/frame/map.h"

namespace selenograph::api {

struct MapBounds {
  double south_deg = 0, north_deg = 0, west_deg = 0, east_deg = 0;
};
const Members<MapBounds>& bounds_members();
// East of the western edge by up to 360 degrees.
dem::Footprint footprint_of(const MapBounds& bounds);

// "map": where it lies.
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
// A valid request itself.
OrderedJson resolved_json(const MapQuery& query);

}  // namespace selenograph::api
