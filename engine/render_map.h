// Map-projected products: each pixel is the ground at its latitude and longitude, met by a vertical ray.
//
// A map is drawn in patches. For each, terrain is selected as for a camera far above that sees the patch with a pixel's
// size on the ground, so level of detail, error bounds and casters of shadows are a frame's; then rays, light and
// shading are a frame's, too (visibility/raytrace/ray_pass.h).
#pragma once

#include <functional>

#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/map.h"
#include "engine/render_cache.h"

namespace selenograph::engine {

// Share of the map that is done, 0 to 1; may be empty.
using MapProgress = std::function<void(double share)>;

// In the caller's task arena. What it throws is what Renderer::map does.
Map render_map(const MapRequest& request, const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop,
               const MapProgress& progress = {});

}  // namespace selenograph::engine
