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

struct FeaturesQuery {
  Named<dem::Detail> detail;
  FeatureKind kind = FeatureKind::craters;
  MapBounds bounds;
  std::optional<double> smallest_m;         // empty: the preset's
  double least_depth = dem::Detail::kWorn;  // of craters, over their diameter

  dem::Footprint region() const;  // its east is larger than its west
  double least_m() const;
  // Approximate upper bound on memory: the craters or rocks with their text, and the search.
  std::size_t bytes() const;
};

const Members<FeaturesQuery>& features_members();
// Throws RequestError("invalid_request") with the faults found, including too many features.
FeaturesQuery read_features(const Json& body, const Limits& limits, const Assets& assets, const StopToken& stop = {});

// In the order of the server's preference.
inline constexpr Alternative kFeaturesAnswers[] = {
    {"application/json", "the craters or rocks, with what they are of"},
    {"text/csv", "a line for each, after one with the columns' names"},
};

// The members of a crater or rock other than its id.
template <typename Feature>
struct FeatureColumn {
  std::string_view name;
  const char* meaning;
  double (*value)(const Feature& feature);
};
std::span<const FeatureColumn<dem::CraterFeature>> crater_columns();
std::span<const FeatureColumn<dem::RockFeature>> rock_columns();
// 16 hexadecimal digits: JSON numbers do not hold 64 bits.
std::string id_text(std::uint64_t id);

// The features of a query.
class FeatureList {
 public:
  FeatureList(const FeaturesQuery& query, const engine::Renderer& renderer, const StopToken& stop = {});

  std::size_t size() const { return craters_.size() + rocks_.size(); }
  // Numbers have the fewest digits that identify them.
  std::string json() const;
  std::string csv() const;

 private:
  const FeaturesQuery& query_;
  StopToken stop_;
  std::vector<dem::CraterFeature> craters_;
  std::vector<dem::RockFeature> rocks_;
};

}  // namespace selenograph::api
