// Eclipses of the Sun by the Earth. The engine does not model them: answers to requests at such epochs have a warning.
#pragma once

#include <nlohmann/json.hpp>

#include "api/requests/map_json.h"
#include "api/requests/points_json.h"

namespace selenograph::api {

// Return the share of the Sun's disc that the Earth covers at the Sun's epoch; 0 if the Sun was not given by an epoch,
// or if no requested product depends on sunlight. The share is seen from the ground below the camera (with poses of
// rows, below the middle pose), in the middle of a map, or below the first ray's origin.
double sun_covered(const FrameQuery& query);
double sun_covered(const MapQuery& query);
double sun_covered(const RaysQuery& query);
double sun_covered(const ProjectQuery& query);

// Appends a warning if the share is not 0. `member` names the answer's member with the share; empty: it has none.
void warn_of_eclipse(double share, std::string_view member, nlohmann::ordered_json& warnings);

}  // namespace selenograph::api
