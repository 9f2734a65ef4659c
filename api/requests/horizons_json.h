// Requests for horizons, and for the light of a time span above them: of the pixels of a map, or of places.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "api/requests/map_json.h"
#include "api/requests/parts/detail_json.h"
#include "api/requests/parts/epochs.h"
#include "api/requests/parts/map_error_json.h"
#include "engine/horizons/map_horizons.h"

namespace selenograph::api {

// A resolved request for horizons.
struct HorizonsQuery {
  std::optional<MapArea> area;     // a map; empty: `places`
  dem::MapGrid grid{};             // of the map
  std::vector<Geographic> places;  // without a map
  Named<dem::Detail> detail{};     // null: none
  std::optional<MapErrorQuery> map_error{};
  engine::HorizonOptions horizon;

  std::size_t size() const {
    return area ? static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height) : places.size();
  }
  // JSON Pointer of the member that says how many horizons there are.
  std::string_view pointer() const { return area ? "/map" : "/places"; }
};

// A resolved request for the light of a time span.
struct IlluminationQuery : HorizonsQuery {
  std::string from_utc, to_utc;
  double step_s = 3600;
  std::vector<std::string> epochs;  // UTC, from from_utc to to_utc
};

const Members<HorizonsQuery>& horizons_members();
const Members<IlluminationQuery>& illumination_members();

// Parse requests. Throw RequestError("invalid_request") with every fault found.
HorizonsQuery read_horizons(const Json& body, const Limits& limits, const Assets& assets = Assets(),
                            const StopToken& stop = {});
IlluminationQuery read_illumination(const Json& body, const Limits& limits, const Assets& assets = Assets(),
                                    const StopToken& stop = {});
// Return the resolved requests, which are valid requests for the same answers.
OrderedJson resolved_json(const HorizonsQuery& query);
OrderedJson resolved_json(const IlluminationQuery& query);

}  // namespace selenograph::api
