// Eclipses of the Sun by the Earth: the light of the ground has none, so that requests at their epochs are warned.
#pragma once

#include <nlohmann/json.hpp>

#include "api/requests/map_json.h"
#include "api/requests/points_json.h"

namespace selenograph::api {

// Share of the Sun's disc that the Earth covers at the epoch that gives the Sun; 0 where no epoch does, or nothing that
// is asked for is the Sun's light. Seen from the ground: below the camera, with poses of rows the middle one's; in a
// map's middle; below the first ray's origin.
double sun_covered(const FrameQuery& query);
double sun_covered(const MapQuery& query);
double sun_covered(const RaysQuery& query);
double sun_covered(const ProjectQuery& query);

// Appends a warning where the share isn't 0. `member`: of the answer, which has the share; empty: none.
void warn_of_eclipse(double share, std::string_view member, nlohmann::ordered_json& warnings);

}  // namespace selenograph::api
