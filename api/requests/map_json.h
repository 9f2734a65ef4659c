// A request for a map: JSON <-> engine::MapRequest, its products as arrays, and what is said about a map.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "api/encode/encode.h"
#include "api/encode/negotiate.h"
#include "api/requests/frame_json.h"
#include "dem/gdal/geotiff_writer.h"
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

// In the order of the server's preference. The last part of each is the extension of the command line's files.
inline constexpr Alternative kMapAnswers[] = {
    {"image/tiff",
     "GeoTIFF: a band for each product (three of normal), of the widest of their types; NoData is NaN, of source "
     "alone 65535; the metadata are the dataset's item SELENOGRAPH"},
    {"application/x-npz", "the products' arrays, and meta.json with the geotransform and WKT"},
    {"image/png",
     "one product but normal, 16 bit grey: 0 is no data, 1 to 65535 from the least to the largest value, of lit from 0 "
     "to 1, of radiance and slope from 0; `png_scale` in the metadata, the text chunk `selenograph`, says which. "
     "source is as it is"},
};

// Of a map while it is in work, besides what is kept between requests, and its answer.
std::size_t bytes_of(const engine::MapRequest& request);

// 32 hexadecimal digits that stand for an answer's bytes, known before anything is rendered. `scene_bytes`: what
// patches are made to fit.
std::string content_hash(const MapQuery& query, std::size_t scene_bytes, std::uint64_t terrain_fingerprint,
                         std::string_view media_type);
OrderedJson metadata(const MapQuery& query, const engine::FrameReport& report, const std::string& hash);

// The answer's bytes. Throws RequestError where the products don't go into a PNG (check_map_answer says so beforehand).
std::string encode_map(const MapQuery& query, const engine::Map& map, const std::string& hash,
                       std::string_view media_type, const StopToken& stop = {});
void check_map_answer(const MapQuery& query, std::string_view media_type);

// The mean of `lit` over a series, as GeoTIFF: one band `illumination_fraction`.
std::string encode_illumination(const MapQuery& query, std::span<const float> fraction, const OrderedJson& meta);

}  // namespace selenograph::api
