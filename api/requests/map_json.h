// A request for a map: JSON <-> engine::MapRequest, and the table of its products.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

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

struct MapQuery {
  engine::MapRequest request;
  MapArea area;
  std::string detail;  // that request.look.detail was found by
  SurfaceQuery surface;
  bool sun_given = false;  // false: no product needs one
};

const Members<MapQuery>& map_members();
// Throws RequestError("invalid_request") with every fault found.
MapQuery read_map(const Json& body, const Limits& limits, const Assets& assets = Assets(), const StopToken& stop = {});
// A valid request itself.
OrderedJson resolved_json(const MapQuery& query);

// Where a map has a product's elements, whose type is the product's.
using MapElements = std::variant<std::vector<std::uint16_t> engine::MapProducts::*,
                                 std::vector<float> engine::MapProducts::*, std::vector<double> engine::MapProducts::*>;

struct MapProductRow {
  engine::MapProduct product;
  std::string_view name;
  MapElements elements;
  std::vector<std::string_view> components;  // empty: one
  std::string_view unit;
  bool needs_sun;
  std::string_view meaning;
};
std::span<const MapProductRow> map_products();
std::string type_text(const MapProductRow& row);

}  // namespace selenograph::api
