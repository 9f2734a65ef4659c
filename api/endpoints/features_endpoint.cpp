// POST /v1/features.
#include "api/answers/metadata.h"
#include "api/endpoints/routes.h"
#include "api/json/ranges.h"
#include "api/requests/features_json.h"
#include "api/requests/parts/detail_json.h"

namespace selenograph::api {
namespace {

// Returns the schema of a crater or rock from its columns.
template <typename Feature>
OrderedJson feature_schema(const char* what, std::span<const FeatureColumn<Feature>> columns) {
  OrderedJson properties{
      {"id", schema::with_keyword(schema::text("the same in every answer"), "pattern", "^[0-9a-f]{16}$")}},
      required = OrderedJson::array({"id"});
  for (const auto& column : columns) {
    properties[std::string(column.name)] = schema::number(kAnyNumber, column.meaning);
    required.push_back(column.name);
  }
  OrderedJson schema = schema::object(what, std::move(properties), {});
  schema["required"] = std::move(required);
  return schema;
}

}  // namespace

Response answer_features(const EndpointContext& context) {
  const std::string_view media_type = accepted(context, kFeaturesAnswers);
  const FeaturesQuery query = read_features(json_body(context), context.limits, context.assets, context.stop);
  context.memory.claim_work(query.bytes(), "/region", context.stop);
  const FeatureList list(query, context.renderer, context.stop);
  Response response = negotiated(context, media_type, media_type == "text/csv" ? list.csv() : list.json());
  OrderedJson warnings = OrderedJson::array();
  if (query.kind == FeatureKind::rocks) warn_of_no_rocks(*query.detail.content, warnings);
  add_warnings(response, warnings);
  return response;
}

void describe_features(Operation& o) {
  using namespace schema;
  o.describe(
      "Truth for crater matchers and hazard detectors: each crater of a detail that the terrain shows, the largest "
      "first. The DEM's posts at its centre decide whether it is shown; one covered by others of its octave of "
      "diameters is left out. The same crater has the same id in every answer. Rocks smaller than the detail's "
      "`rocks.smallest_m` are part of its heights, and not listed.");
  o.body("/v1/features", features_members());
  o.answer_as_accepted(kFeaturesAnswers, "FeaturesAnswer", {"Vary", "Selenograph-Warnings"});
  OrderedJson crater = feature_schema("A crater of the detail.", crater_columns()),
              rock = feature_schema("A rock of the detail.", rock_columns());
  const OrderedJson detail = object("the detail, as in a frame's metadata",
                                    {{"name", text("as asked")},
                                     {"version", text("changes when the preset changes")},
                                     {"synthetic", text("what of the terrain is made up")},
                                     {"sources", free_object("where each law was measured, and what is extrapolated")}},
                                    {"name", "version", "synthetic"});
  const OrderedJson region = object("as asked, degrees",
                                    {{"south_deg", number(kLatitude_deg, "")},
                                     {"north_deg", number(kLatitude_deg, "")},
                                     {"west_deg", number(kLongitude_deg, "")},
                                     {"east_deg", number({-180, 720}, "west_deg < east_deg <= west_deg + 360")}},
                                    {"south_deg", "north_deg", "west_deg", "east_deg"});
  o.schema("FeaturesAnswer", object("Craters, or rocks, with their centre in the region, the largest first.",
                                    {{"detail", detail},
                                     {"region", region},
                                     {"smallest_m", number(kAnyNumber, "least diameter_m")},
                                     {"craters", array(std::move(crater))},
                                     {"rocks", array(std::move(rock))}},
                                    {"detail", "region", "smallest_m"}));
}

}  // namespace selenograph::api
