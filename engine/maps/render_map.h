// Map-projected products: each pixel is the ground at its latitude and longitude, hit by a vertical ray.
//
//   map --> patches, 512 x 512 pixels --> view from far above --> selection --> scene --> vertical rays --> products
//                ^                                                   |
//                +------- halves, if the terrain is too much --------+
//
// A map is rendered in patches. For each patch, terrain is selected as for a camera far above it whose pixels have the
// map's size on the ground, so level of detail, error bounds and occluders are those of a frame. Rays, light and
// shading are a frame's, too (visibility/raytrace/ray_pass.h).
#pragma once

#include <functional>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/cache/render_cache.h"
#include "engine/frame/map.h"

namespace selenograph::engine {

// Receives the finished share of the map, 0 to 1; may be empty.
using MapProgress = std::function<void(double share)>;

// Implements Renderer::map. Runs in the caller's task arena.
Map render_map(const MapRequest& request, const dem::Terrain& terrain, RenderCache& cache, const StopToken& stop,
               const MapProgress& progress = {});

}  // namespace selenograph::engine
