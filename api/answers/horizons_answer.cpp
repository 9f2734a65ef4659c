#include "api/answers/horizons_answer.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <iterator>
#include <span>
#include <utility>

#include "api/answers/metadata_members.h"
#include "api/encode/encode.h"
#include "api/message/json_text.h"
#include "api/message/version.h"
#include "dem/gdal/geotiff_writer.h"
#include "engine/relief/horizon_march.h"

namespace selenograph::api {
namespace {

// A statistic of the light: a band, an array or a member.
struct Statistic {
  const char* name;
  const char* unit;
  const char* meaning;
  std::vector<float> engine::Illumination::*values;
};
constexpr Statistic kStatistics[] = {
    {"sun_mean", "", "mean visible share of the Sun's disc, 0 to 1", &engine::Illumination::sun_mean},
    {"earth_mean", "", "mean visible share of the Earth's disc", &engine::Illumination::earth_mean},
    {"longest_night_h", "h", "longest run of epochs without any of the Sun's disc, an epoch as long as a step",
     &engine::Illumination::longest_night_h},
    {"nights", "", "number of such runs", &engine::Illumination::nights},
    {"longest_without_earth_h", "h", "longest run of epochs without any of the Earth's disc",
     &engine::Illumination::longest_without_earth_h},
};

// Returns a number as JSON; null for NaN.
OrderedJson number_json(float value) {
  return std::isnan(value) ? OrderedJson() : OrderedJson(static_cast<double>(value));
}

// Returns every `step`-th element from `first` on, as JSON.
OrderedJson column_json(std::span<const float> values, std::size_t first, std::size_t step) {
  OrderedJson json = OrderedJson::array();
  for (std::size_t i = first; i < values.size(); i += step) json.push_back(number_json(values[i]));
  return json;
}

double azimuth_deg(const HorizonsQuery& query, int i) { return 360.0 * i / query.horizon.azimuths; }

OrderedJson meta_of(const HorizonsQuery& query, const engine::HorizonReport& report, OrderedJson request) {
  OrderedJson meta{{"software", {{"name", "selenograph"}, {"version", software_version()}}},
                   {"request", std::move(request)},
                   {"missing_places", report.missing_places},
                   {"finest_spacing_m", report.min_spacing_m},
                   {"tolerance_deg", engine::kHorizonTolerance_deg}};
  if (query.area) meta["grid"] = grid_json(query.grid);
  if (query.detail.content) meta["detail"] = detail_metadata(query.detail.name, *query.detail.content);
  return meta;
}

OrderedJson place_json(const Geographic& g) { return {{"lat_deg", g.lat_deg}, {"lon_deg", g.lon_deg}}; }

// Returns a float32 array of any shape.
ArrayView array_of(std::string_view name, std::span<const float> values, std::vector<std::size_t> shape) {
  return {name, ElementType::float32, static_cast<int>(values.size()), 1, 1, values.data(), {}, std::move(shape)};
}

std::vector<std::size_t> shape_of(const HorizonsQuery& query) {
  if (!query.area) return {query.places.size()};
  return {static_cast<std::size_t>(query.grid.height), static_cast<std::size_t>(query.grid.width)};
}

std::vector<Vec3> directions_of(const std::vector<Geographic>& places) {
  std::vector<Vec3> directions;
  for (const Geographic& place : places) directions.push_back(local_axes(place.lat_deg, place.lon_deg).up);
  return directions;
}

std::vector<std::size_t> with_first(std::size_t first, std::vector<std::size_t> shape) {
  shape.insert(shape.begin(), first);
  return shape;
}

}  // namespace

bool holds(const HorizonsQuery& query, std::string_view media_type) {
  if (media_type == "image/tiff") return query.area.has_value();
  return media_type == "application/x-npz" || !query.area;
}

engine::HorizonElevations find(const HorizonsQuery& query, const engine::RenderContext& rendering,
                               const engine::HorizonProgress& progress) {
  if (query.area) return engine::map_horizons(query.grid, query.horizon, rendering, progress);
  return engine::place_horizons(directions_of(query.places), query.horizon, rendering, progress);
}

engine::IlluminationSeries find(const IlluminationQuery& query, const engine::RenderContext& rendering,
                                const engine::HorizonProgress& progress) {
  const engine::BodySeries bodies = engine::bodies_at(query.epochs, query.step_s);
  if (query.area) return {{}, {}, engine::illumination_of_map(query.grid, query.horizon, bodies, rendering, progress)};
  return engine::illumination_of_places(directions_of(query.places), query.horizon, bodies, rendering, progress);
}

// A value takes 4 bytes, as much again in the answer, and 12 to 20 bytes of text in JSON or CSV.
std::size_t bytes_of(const HorizonsQuery& query) {
  constexpr std::size_t kBytesPerValue = 12, kBytesPerText = 60;
  return query.size() * static_cast<std::size_t>(query.horizon.azimuths) *
         (query.area ? kBytesPerValue : kBytesPerText);
}
std::size_t bytes_of(const IlluminationQuery& query) {
  constexpr std::size_t kBytesPerPlace = 100, kBytesPerText = 120;
  return query.size() * kBytesPerPlace + query.epochs.size() * query.places.size() * kBytesPerText;
}

std::string encode(const HorizonsQuery& query, const engine::HorizonElevations& found, std::string_view media_type,
                   const StopToken& stop) {
  const OrderedJson meta = meta_of(query, found.report, resolved_json(query));
  const auto azimuths = static_cast<std::size_t>(query.horizon.azimuths);
  if (media_type == "image/tiff") {
    std::vector<dem::MapBand> bands;
    for (std::size_t i = 0; i < azimuths; ++i)
      bands.push_back({fmt::format("horizon at azimuth {:g}", azimuth_deg(query, static_cast<int>(i))), "deg",
                       found.elevation_deg.data() + i * query.size()});
    return dem::geotiff_bytes(query.grid, bands, json_ascii(meta), stop);
  }
  if (media_type == "application/x-npz") {
    std::vector<float> directions(azimuths);
    for (std::size_t i = 0; i < azimuths; ++i)
      directions[i] = static_cast<float>(azimuth_deg(query, static_cast<int>(i)));
    return encode_npz({array_of("elevation_deg", found.elevation_deg, with_first(azimuths, shape_of(query))),
                       array_of("azimuth_deg", directions, {azimuths})},
                      json_text(meta, 2), stop);
  }
  OrderedJson places = OrderedJson::array();
  for (std::size_t i = 0; i < query.places.size(); ++i) {
    OrderedJson item = place_json(query.places[i]);
    item["elevation_deg"] = column_json(found.elevation_deg, i, query.places.size());
    places.push_back(std::move(item));
  }
  return json_line(OrderedJson{{"places", std::move(places)}, {"meta", meta}});
}

std::string encode(const IlluminationQuery& query, const engine::IlluminationSeries& found, std::string_view media_type,
                   const StopToken& stop) {
  OrderedJson meta = meta_of(query, found.summary.report, resolved_json(query));
  meta["epochs"] = query.epochs.size();
  if (media_type == "image/tiff") {
    std::vector<dem::MapBand> bands;
    for (const Statistic& s : kStatistics) bands.push_back({s.name, s.unit, (found.summary.*s.values).data()});
    return dem::geotiff_bytes(query.grid, bands, json_ascii(meta), stop);
  }
  if (media_type == "application/x-npz") {
    std::vector<ArrayView> arrays;
    for (const Statistic& s : kStatistics) arrays.push_back(array_of(s.name, found.summary.*s.values, shape_of(query)));
    if (!query.area)
      for (const auto& [name, values] : {std::pair("sun", &found.sun), std::pair("earth", &found.earth)})
        arrays.push_back(array_of(name, *values, with_first(query.epochs.size(), shape_of(query))));
    return encode_npz(arrays, json_text(meta, 2), stop);
  }
  if (media_type == "text/csv") {
    std::string text = "utc";
    for (std::size_t i = 1; i <= query.places.size(); ++i) text += fmt::format(",sun_{},earth_{}", i, i);
    text += '\n';
    for (std::size_t e = 0; e < query.epochs.size(); ++e) {
      text += query.epochs[e];
      for (std::size_t i = e * query.places.size(); i < (e + 1) * query.places.size(); ++i)
        fmt::format_to(std::back_inserter(text), ",{:.6g},{:.6g}", found.sun[i], found.earth[i]);
      text += '\n';
    }
    return text;
  }
  OrderedJson places = OrderedJson::array();
  for (std::size_t i = 0; i < query.places.size(); ++i) {
    OrderedJson item = place_json(query.places[i]);
    for (const Statistic& s : kStatistics) item[s.name] = number_json((found.summary.*s.values)[i]);
    item["sun"] = column_json(found.sun, i, query.places.size());
    item["earth"] = column_json(found.earth, i, query.places.size());
    places.push_back(std::move(item));
  }
  return json_line(OrderedJson{{"places", std::move(places)}, {"meta", std::move(meta)}});
}

namespace {

// Returns the schema of an answer of places: each has its latitude and longitude and these members.
OrderedJson places_schema(const char* description, OrderedJson members) {
  using namespace schema;
  OrderedJson properties{{"lat_deg", number(kLatitude_deg, "as asked")},
                         {"lon_deg", number(kLongitude_deg, "as asked")}};
  properties.update(members);
  return object(description,
                {{"places", array(object("a place", std::move(properties), {"lat_deg", "lon_deg"}),
                                  "in the order of the request")},
                 {"meta", free_object("software, request, missing_places, finest_spacing_m (of the heights), "
                                      "tolerance_deg (by which ground may rise above a horizon), epochs")}},
                {"places", "meta"});
}

}  // namespace

OrderedJson horizons_schema() {
  using namespace schema;
  return places_schema(
      "Horizons of places.",
      {{"elevation_deg", array(number_or_null("elevation; null: no data"), "at each azimuth, clockwise from north")}});
}

OrderedJson illumination_schema() {
  using namespace schema;
  OrderedJson members;
  for (const Statistic& s : kStatistics) members[s.name] = number_or_null(s.meaning);
  members["sun"] = array(number_or_null("share of the Sun's disc, limb darkening included"), "at each epoch");
  members["earth"] = array(number_or_null("share of the Earth's disc"), "at each epoch");
  return places_schema("Light at places.", std::move(members));
}

}  // namespace selenograph::api
