// Requests for maps: JSON to engine::MapRequest and back.
#pragma once

#include <optional>

#include "api/requests/frame_json.h"
#include "api/requests/parts/map_error_json.h"
#include "engine/frame/map.h"

namespace selenograph::api {

// Outer edges of a map or region as a client writes them; west_deg above east_deg: across 180 degrees.
struct MapBounds {
  double south_deg = 0, north_deg = 0, west_deg = 0, east_deg = 0;
};
const Members<MapBounds>& bounds_members();
// Returns the bounds with east_deg in (west_deg, west_deg + 360]: 170 to -170 becomes 170 to 190.
dem::Footprint footprint_of(const MapBounds& bounds);

// A rectangle of a map's pixels, from its north-west corner.
struct MapWindow {
  int x_px = 0, y_px = 0, width_px = 0, height_px = 0;
};

// "map": projection and extent, either by `bounds` or by `center`, `width_m` and `height_m`.
struct MapArea {
  dem::MapProjection projection = dem::MapProjection::equirectangular;
  std::optional<MapBounds> bounds;
  std::optional<Geographic> center;
  std::optional<double> width_m, height_m;
  double gsd_m = 0;
  std::optional<double> standard_parallel_deg;
  std::optional<MapWindow> window;  // empty: the entire map
};
const Members<MapArea>& area_members();
// Returns the grid of a map, or of its window; empty if it is not possible or has too many pixels, which is reported.
std::optional<dem::MapGrid> grid_of(const JsonReader& in, const MapArea& area, const Limits& limits);
// Returns the grid of a request with a member "map". Throws RequestError("invalid_request") with every fault found.
dem::MapGrid read_grid(const Json& body, const Limits& limits);

// A resolved request for a map: the engine's request, and the area from which its grid follows.
struct MapQuery : SceneryQuery {
  engine::MapRequest request;
  MapArea area;
  std::optional<MapErrorQuery> map_error;

  engine::FrameRequest& scenery() { return request.scenery; }
  const engine::FrameRequest& scenery() const { return request.scenery; }
};

const Members<MapQuery>& map_members();
// Parses a request. Throws RequestError("invalid_request") with every fault found.
MapQuery read_map(const Json& body, const Limits& limits, const Assets& assets = Assets(), const StopToken& stop = {});
// Returns the resolved request, which is a valid request for the same map.
OrderedJson resolved_json(const MapQuery& query);

}  // namespace selenograph::api
