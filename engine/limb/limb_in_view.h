// The terrain-true limb and terminator of the Moon in a camera's image: POST /v1/limb.
#pragma once

#include <vector>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/cache/render_cache.h"
#include "engine/frame/limb.h"

namespace selenograph::engine {

// Both run in the caller's task arena. Results and exceptions are those of Renderer::limb and Renderer::terminator.
std::vector<LimbPoint> find_limb(const LimbRequest& request, const dem::Terrain& terrain, const StopToken& stop);
std::vector<TerminatorPoint> find_terminator(const LimbRequest& request, const dem::Terrain& terrain,
                                             RenderCache& cache, const StopToken& stop);

}  // namespace selenograph::engine
