// Image positions of the craters of a frame's detail: ground truth for crater detectors.
#pragma once

#include <vector>

#include "dem/detail/features.h"
#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/request.h"
#include "engine/frame/rims.h"
#include "engine/render_cache.h"

namespace selenograph::engine {

// Implements Renderer::rims. Runs in the caller's task arena. The terrain must have the request's detail.
CraterRims crater_rims(const FrameRequest& request, const RimOptions& options, const dem::Terrain& terrain,
                       RenderCache& kept, const StopToken& stop);

}  // namespace selenograph::engine
