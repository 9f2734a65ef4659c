// The schema of what POST /v1/features answers.
#include "api/document/openapi.h"
#include "api/json/ranges.h"
#include "api/requests/features_json.h"
#include "api/schema/answers.h"

namespace selenograph::api {

using namespace schema;

namespace {

template <typename Feature>
OrderedJson listed(const char* what, std::span<const FeatureColumn<Feature>> columns) {
  OrderedJson properties{{"id", with(text("the same in every answer"), "pattern", "^[0-9a-f]{16}$")}},
      required = OrderedJson::array({"id"});
  for (const auto& column : columns) {
    properties[std::string(column.name)] = number(kAnyNumber, column.meaning);
    required.push_back(column.name);
  }
  OrderedJson schema = object(what, std::move(properties), {});
  schema["required"] = std::move(required);
  return schema;
}

}  // namespace

void add_feature_answers(OrderedJson& schemas) {
  OrderedJson crater = listed("A crater of the detail.", crater_columns()),
              rock = listed("A rock of the detail.", rock_columns());
  const OrderedJson detail = object("what they are of, as in a frame's metadata",
                                    {{"name", text("as asked")},
                                     {"version", text("changes when the preset changes")},
                                     {"synthetic", text("what of the terrain is made up")}},
                                    {"name", "version", "synthetic"});
  const OrderedJson region = object("as asked, degrees",
                                    {{"south_deg", number(kLatitude_deg, "")},
                                     {"north_deg", number(kLatitude_deg, "")},
                                     {"west_deg", number(kLongitude_deg, "")},
                                     {"east_deg", number({-180, 720}, "west_deg < east_deg <= west_deg + 360")}},
                                    {"south_deg", "north_deg", "west_deg", "east_deg"});
  schemas["FeaturesAnswer"] = object("Craters, or rocks, with their centre in the region, the largest first.",
                                     {{"detail", detail},
                                      {"region", region},
                                      {"smallest_m", number(kAnyNumber, "least diameter_m")},
                                      {"craters", array(std::move(crater))},
                                      {"rocks", array(std::move(rock))}},
                                     {"detail", "region", "smallest_m"});
}

}  // namespace selenograph::api
