// Light at single points of the ground, for POST /v1/rays and POST /v1/project.
#pragma once

#include <span>
#include <vector>

#include "engine/frame/request.h"
#include "engine/indirect/light_lanes.h"
#include "engine/rays/ray_queries.h"

namespace selenograph::engine {

// Returns the light from Sun, terrain and Earth at each point, as in a frame of the request: its Sun, ground, band,
// detail and indirect light are used. Terrain light is gathered at posts as close as the terrain's own; points near
// each other share them. Parallel; throws as LightTiles::get does.
std::vector<Irradiance> light_at_places(std::span<const LitPlace> places, const FrameRequest& request,
                                        const RenderContext& context);

}  // namespace selenograph::engine
