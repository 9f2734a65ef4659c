// Hazards for landing around each pixel of a map: slope and roughness over a lander's footprint, and rocks.
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

// Returns whether any requested product needs the footprint.
bool wants_footprint(const MapRequest& request);

// Returns the map to draw before find_hazards(): with heights in place of the footprint's products, and so much larger
// that footprints at the border are complete. Throws ImpossibleRequest (member "footprint") if footprints reach too
// many pixels.
MapRequest request_with_margin(const MapRequest& request);

// Returns an upper bound on the memory that find_hazards() takes in addition to the products. `drawn`: the request that
// request_with_margin() returned.
std::size_t bytes_of_footprints(const MapRequest& request, const MapRequest& drawn);

// Adds the footprint's products to a drawn map and cuts its margin off. A pixel gets NaN and kNoHazardNumber if ground
// in its footprint has no data, or if the map's scale leaves no footprint that determines a plane; the latter pixels
// are counted in a returned warning. Parallel.
std::vector<std::string> find_hazards(const MapRequest& request, const MapRequest& drawn, FrameProducts& products,
                                      const StopToken& stop);

}  // namespace selenograph::engine
