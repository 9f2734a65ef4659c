// Image positions of the craters of a frame's detail: ground truth for crater detectors.
#pragma once

#include <memory>
#include <span>

#include "dem/base/stop_token.h"
#include "dem/detail/crater_visibility.h"
#include "dem/detail/features.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/request.h"
#include "engine/frame/rims.h"
#include "engine/scene/selected_blocks.h"

namespace selenograph::engine {

// Craters that a frame shows, as request.craters asks. `selection`: its blocks; a crater is placed on their triangles,
// and one is shown where they are fine enough for its octave. `range_m`: of every pixel, NaN for the sky; it decides
// what stands before a rim. The terrain has the request's detail, and `roughness` is that of it. Runs in the caller's
// task arena. Throws ImpossibleRequest for too many craters (needs.h).
CraterRims crater_rims(const FrameRequest& request, const Selection& selection, std::span<const double> range_m,
                       const dem::Terrain& terrain, std::shared_ptr<const dem::CraterRoughness> roughness,
                       const StopToken& stop);

}  // namespace selenograph::engine
