// Ground that is unsafe for landing, around each pixel of a map: slope and roughness over a lander's footprint, rocks.
//
// A plane is fitted by least squares to the heights of the pixels that the lander stands on (all of the footprint, or
// its legs' ends). Slope is that plane's angle to the sphere's vertical; roughness the largest distance from it of any
// ground in the footprint, up or down. These are the measures of hazard detection for landing: Epp, Robertson &
// Brady, Autonomous Landing and Hazard Avoidance Technology (ALHAT), IEEE Aerospace Conference 2008.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/frame/map.h"

namespace selenograph::engine {

// Whether any product or limit is of the footprint.
bool wants_footprint(const MapRequest& request);

// The area to draw for a map with these products: the map, wider by what footprints at its border cover, with heights.
// Throws ImpossibleRequest (member "footprint") where footprints reach too many pixels.
MapRequest drawn_for(const MapRequest& request);

// Memory that find_hazards() takes beside the products, at most. `drawn`: drawn_for() that request, as below.
std::size_t bytes_of_footprints(const MapRequest& request, const MapRequest& drawn);

// From what was drawn to what is asked for: adds the products of the footprint, cuts the border off. NaN and
// kNoHazardNumber where ground in the footprint has no data, or where the map's scale leaves no footprint that a plane
// can be fitted in: of those pixels a warning is returned. Parallel.
std::vector<std::string> find_hazards(const MapRequest& request, const MapRequest& drawn, FrameProducts& products,
                                      const StopToken& stop);

}  // namespace selenograph::engine
