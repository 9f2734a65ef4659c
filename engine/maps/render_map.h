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

#include "engine/frame/map.h"

namespace selenograph::engine {

struct RenderContext;

// Receives the finished share of the map, 0 to 1, from time to time, from one thread at a time; may be empty.
using MapProgress = std::function<void(double share)>;

// Renders a map. Throws as Renderer::render does.
Map render_map(const MapRequest& request, const RenderContext& context, const MapProgress& progress = {});

}  // namespace selenograph::engine
