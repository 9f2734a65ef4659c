// Requests for a detail's craters: JSON -> a region, and the answers as JSON and CSV.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "api/detail_json.h"
#include "api/map_json.h"
#include "api/negotiate.h"
#include "dem/catalogue.h"
#include "dem/detail/features.h"

namespace selenograph::api {

struct FeaturesQuery {
  Named<dem::Detail> detail;
  MapBounds bounds;
  std::optional<double> smallest_m;  // empty: the preset's

  dem::Footprint region() const;  // east of its west
  double least_m() const { return smallest_m.value_or(detail.content->preset().craters.smallest_m); }
  // About as many as there are at most.
  double most() const;
};

const Members<FeaturesQuery>& features_members();
// Throws RequestError("invalid_request") with the faults found, too many craters among them.
FeaturesQuery read_features(const Json& body, const Limits& limits, const Assets& assets = Assets(),
                            const StopToken& stop = {});

// In the order of the server's preference.
inline constexpr Alternative kFeaturesAnswers[] = {
    {"application/json", "the craters, with what they are of"},
    {"text/csv", "a line for each crater, after one with the columns' names"},
};

// What is said of a crater besides its id.
struct CraterColumn {
  std::string_view name;
  const char* meaning;
  double (*value)(const dem::CraterFeature& feature);
};
std::span<const CraterColumn> crater_columns();
// 16 hexadecimal digits: JSON's numbers have no room for 64 bits.
std::string id_text(const dem::CraterFeature& feature);

// Numbers in as few digits as tell them from all others.
std::string features_json(const FeaturesQuery& query, std::span<const dem::CraterFeature> craters);
std::string features_csv(std::span<const dem::CraterFeature> craters);

}  // namespace selenograph::api
