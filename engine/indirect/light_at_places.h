// The light that arrives at single places on the ground: what POST /v1/rays and POST /v1/project say of it.
#pragma once

#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/queries.h"
#include "engine/frame/request.h"
#include "engine/indirect/light_tile.h"

namespace selenograph::engine {

// In the order of the places. Light from the Sun, terrain and Earth as in a frame of the request, gathered at posts as
// close as the terrain's own. Places near each other share them. Parallel; throws as LightTiles::get does.
std::vector<Irradiance> light_at_places(std::span<const LitPlace> places, const FrameRequest& request,
                                        const dem::Terrain& terrain, LightTiles& tiles, const StopToken& stop);

}  // namespace selenograph::engine
