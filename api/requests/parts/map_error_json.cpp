// Tables of a request's members (api/schema/members.h). A row is m.add(name in JSON, field of the C++ struct, kind,
// meaning); the kind gives type, range and unit. Rules across members, checks and conversions follow the rows.
#include "api/requests/parts/map_error_json.h"

#include <fmt/format.h>

#include "api/json/ranges.h"

namespace selenograph::api {
namespace {

using dem::MapError;

constexpr Range kCorrelationLength_m{1, 5e5}, kShift_m{-1e4, 1e4};
constexpr std::size_t kMaxFields = 8;
constexpr std::int64_t kMaxMapErrorSeed = std::int64_t{1} << 53;
constexpr const char* kCorrelationLength =
    "distance over which the correlation falls to 1/e: it is exp(-(d/L)^2) within 0.008";

const auto layer_field = Property{[](const MapError::Field& field) -> std::optional<Named<dem::ValueMap>> {
                                    if (!field.layer.content) return std::nullopt;
                                    return Named<dem::ValueMap>{field.layer.name, field.layer.content};
                                  },
                                  [](MapError::Field& field, Named<dem::ValueMap> layer) {
                                    field.layer = {std::move(layer.name), std::move(layer.content)};
                                  }};

const Members<MapError::Field>& height_error_members() {
  static const auto table = make_table<Members<MapError::Field>>(
      "HeightErrorField", "A Gaussian random field of zero mean that is added to the heights.", [](auto& m) {
        m.add("standard_deviation_m", &MapError::Field::standard_deviation, Number{{0, 100}, "m"},
              "standard deviation of the heights' error; with a `layer`, the largest that it gives: what is above is "
              "cut")
            .required();
        m.add("layer", layer_field, Asset{&Assets::map, "map", "maps"},
              "a product's layer of height errors: maps/NAME.json of the assets folder, whose values are the standard "
              "deviation at each place in metres, 0 where it has no data; left out: the same everywhere");
        m.add("correlation_length_m", &MapError::Field::correlation_length_m, Number{kCorrelationLength_m, "m"},
              kCorrelationLength)
            .required();
      });
  return *table;
}

const Members<MapError::Field>& albedo_error_members() {
  static const auto table = make_table<Members<MapError::Field>>(
      "AlbedoErrorField", "A Gaussian random field of zero mean; the albedo is multiplied by 1 plus the sum of fields.",
      [](auto& m) {
        m.add("standard_deviation", &MapError::Field::standard_deviation, Number{{0, 0.5}},
              "standard deviation of the albedo's error, as a share of the albedo")
            .required();
        m.add("correlation_length_m", &MapError::Field::correlation_length_m, Number{kCorrelationLength_m, "m"},
              kCorrelationLength)
            .required();
      });
  return *table;
}

const Members<MapError::Place>& error_place_members() {
  static const auto table = make_table<Members<
      MapError::Place>>("MapErrorPlace", "Place where shift and tilt apply as stated, as a landing site.", [](auto& m) {
    m.add("lat_deg", &MapError::Place::lat_deg, Number{kLatitude_deg, "deg"}, "latitude").required();
    m.add("lon_deg", &MapError::Place::lon_deg, Number{kLongitude_deg, "deg"}, "longitude, east-positive").required();
    m.add("height_m", &MapError::Place::height_m, Number{{-12000, 13000}, "m"},
          "height above the sphere of 1 737 400 m that `scale` leaves unchanged");
  });
  return *table;
}

const Members<MapError::Shift>& shift_members() {
  static const auto table = make_table<Members<MapError::Shift>>(
      "MapErrorShift",
      "Displacement of the map's ground, by a rotation about the Moon's centre: exact at `about`, and undistorted "
      "everywhere.",
      [](auto& m) {
        m.add("north_m", &MapError::Shift::north_m, Number{kShift_m, "m"}, "to the north");
        m.add("east_m", &MapError::Shift::east_m, Number{kShift_m, "m"}, "to the east");
      });
  return *table;
}

const Members<MapError::Tilt>& tilt_members() {
  static const auto table = make_table<Members<MapError::Tilt>>(
      "MapErrorTilt",
      "A plane through `about` that is added to the heights. It fades with the distance d as exp(-(d / 300 km)^2 / 2).",
      [](auto& m) {
        m.add("slope_deg", &MapError::Tilt::slope_deg, Number{{0, 0.5}, "deg"}, "slope of the plane").required();
        m.add("azimuth_deg", &MapError::Tilt::azimuth_deg, Number{{-360, 360}, "deg"},
              "direction in which it rises, clockwise from north");
      });
  return *table;
}

auto of_error(auto field) { return nested(&MapErrorQuery::error, field); }

}  // namespace

const Members<MapErrorQuery>& map_error_members() {
  static const auto table = make_table<Members<MapErrorQuery>>(
      "MapError",
      "Errors of a lander's map, functions of place and seed, in the order in which they are made: "
      "`missing_craters_below_m`, `resolution_m`, `shift`, `scale`, `tilt`, `height`, `albedo`. Only the random fields "
      "have zero mean.",
      [](auto& m) {
        m.add("preset", &MapErrorQuery::preset, Text{},
              "map_errors/NAME.json of the assets folder, the errors of a published product; other members override "
              "its own")
            .written_if([](const MapErrorQuery& q) { return !q.preset.empty(); });
        m.add("seed", of_error(&MapError::seed), Integer{0, kMaxMapErrorSeed}, "of the random fields");
        m.add("missing_craters_below_m", of_error(&MapError::missing_craters_below_m), Number{{0, 5000}, "m"},
              "craters of `detail` below this diameter, rounded up to a power of two, are missing, and with them its "
              "rocks, fragments and clods; 0: none");
        m.add("resolution_m", of_error(&MapError::resolution_m), Number{{0, 1e5}, "m"},
              "spacing of the map's posts: the terrain's level of this spacing or the next coarser one, which "
              "has a low-pass filter; 0: the terrain's finest");
        m.add("about", of_error(&MapError::about), Object{error_place_members()}, "where `shift` and `tilt` are exact")
            .written_if([](const MapErrorQuery& q) { return q.error.about != MapError::Place(); });
        m.add("shift", of_error(&MapError::shift), Object{shift_members()}, "displacement along the surface")
            .written_if([](const MapErrorQuery& q) { return q.error.is_shifted(); });
        m.add("scale", of_error(&MapError::scale), Number{{0.9, 1.1}},
              "factor of the heights' distances from `about.height_m`");
        m.add("tilt", of_error(&MapError::tilt), Object{tilt_members()}, "tilt of the heights")
            .written_if([](const MapErrorQuery& q) { return q.error.tilt.slope_deg != 0; });
        m.add("height", of_error(&MapError::height), List{Object{height_error_members()}, 0, kMaxFields},
              "random errors of the heights; their sum");
        m.add("albedo", of_error(&MapError::albedo), List{Object{albedo_error_members()}, 0, kMaxFields},
              "random errors of the albedo; their sum");
        m.needs("shift", {"about"});
        m.needs("tilt", {"about"});
      });
  return *table;
}

// Reads the request's own members first, so that faults have their pointers in the request. Faults of the preset's file
// are the operator's: they are reported as "asset_error" with the file's name.
std::optional<MapErrorQuery> MapErrorObject::read(const JsonReader& in, const ReadContext& context) const {
  std::optional<MapErrorQuery> own = map_error_members().read(in, context);
  if (!own || own->preset.empty()) return own;
  const auto preset = Asset{&Assets::map_error, "preset", "map_errors"}.read(in.at("preset"), context);
  if (!preset) return std::nullopt;
  Json merged = *preset->content;
  for (const char* text : {"description", "sources"}) merged.erase(text);
  map_error_members().check_file(merged, fmt::format("map_errors/{}.json", preset->name), context);
  merged.merge_patch(in.value());
  Findings findings;
  auto query = map_error_members().read(JsonReader(merged, findings), context);
  if (query && preset->content->contains("sources")) query->sources = preset->content->at("sources");
  return query;
}

OrderedJson map_error_metadata(const MapErrorQuery& query) {
  OrderedJson metadata = map_error_members().write(query);
  if (!query.sources.is_null()) metadata["sources"] = query.sources;
  return metadata;
}

void warn_of_map_error(const MapErrorQuery& query, bool has_detail, OrderedJson& warnings) {
  if (query.error.missing_craters_below_m > 0 && !has_detail)
    warnings.push_back("map_error.missing_craters_below_m changes nothing without \"detail\": the craters are its");
  MapError seeded;
  seeded.seed = query.error.seed;
  seeded.about = query.error.about;
  if (query.error == seeded) warnings.push_back("map_error states no error: the map is the terrain");
}

}  // namespace selenograph::api
