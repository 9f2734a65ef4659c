// The craters of a frame's detail in its image: truth for crater detectors.
#pragma once

#include <vector>

#include "dem/detail/features.h"
#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/request.h"
#include "engine/frame/rims.h"
#include "engine/render_cache.h"

namespace selenograph::engine {

// In the caller's task arena. Throws and answers as Renderer::rims does. The terrain has the request's detail.
CraterRims crater_rims(const FrameRequest& request, const RimOptions& options, const dem::Terrain& terrain,
                       RenderCache& kept, const StopToken& stop);

}  // namespace selenograph::engine
