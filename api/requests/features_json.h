// Requests for a detail's craters and rocks, and their answers as JSON and CSV.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "api/encode/negotiate.h"
#include "api/requests/map_json.h"
#include "api/requests/parts/detail_json.h"
#include "dem/catalogue/catalogue.h"
#include "dem/detail/features.h"
#include "dem/detail/rocks_on_ground.h"
#include "engine/renderer.h"

namespace selenograph::api {

enum class FeatureKind { craters, rocks };

// A resolved request: the features of one kind in a region, from a minimum diameter.
struct FeaturesQuery {
  Named<dem::Detail> detail;
  FeatureKind kind = FeatureKind::craters;
  MapBounds bounds;
  std::optional<double> smallest_m;                     // minimum diameter, m; empty: the preset's
  double min_depth_over_diameter = dem::Detail::kWorn;  // craters only

  // Returns the bounds with east_deg > west_deg, also across the date line.
  dem::Footprint region() const;
  // Returns smallest_m, or the smallest diameter of the preset's craters or rocks.
  double min_diameter_m() const;
  // Returns an approximate upper bound on memory: the craters or rocks with their text, and the search.
  std::size_t bytes() const;
};

const Members<FeaturesQuery>& features_members();
// Parses a request. Throws RequestError("invalid_request") with the faults found, including too many features.
FeaturesQuery read_features(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop = {});

// Media types of the answer, in the order of the server's preference.
inline constexpr Alternative kFeaturesAnswers[] = {
    {"application/json", "the craters or rocks, with what they are of"},
    {"text/csv", "a line for each, after one with the columns' names"},
};

// A member of a crater or rock in JSON, or a column in CSV. The id, which is a text, has no row.
template <typename Feature>
struct FeatureColumn {
  std::string_view name;
  const char* meaning;
  double (*value)(const Feature& feature);
};
std::span<const FeatureColumn<dem::CraterFeature>> crater_columns();
std::span<const FeatureColumn<dem::RockFeature>> rock_columns();
// Returns 16 hexadecimal digits: JSON numbers do not hold 64 bits.
std::string id_text(std::uint64_t id);

// Craters or rocks that a query selects, and their text.
class FeatureList {
 public:
  FeatureList(const FeaturesQuery& query, const engine::Renderer& renderer, const StopToken& stop = {});

  std::size_t size() const { return craters_.size() + rocks_.size(); }
  // Return the answer. Numbers have the fewest digits from which the same double is read back.
  std::string json() const;
  std::string csv() const;

 private:
  const FeaturesQuery& query_;
  StopToken stop_;
  std::vector<dem::CraterFeature> craters_;
  std::vector<dem::RockFeature> rocks_;
};

}  // namespace selenograph::api
