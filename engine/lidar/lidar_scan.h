// A lidar's scan: beams against the finest terrain with detail, rocks and objects. POST /v1/lidar.
#pragma once

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/cache/render_cache.h"
#include "engine/frame/lidar.h"

namespace selenograph::engine {

// Runs in the caller's task arena. The same request on the same terrain gives the same numbers. Throws
// ImpossibleRequest if the instrument is below the terrain or inside an object at any tested pulse, TooMuchTerrain if a
// single beam runs along more terrain than memory holds, Cancelled when stopped.
LidarReturns scan_lidar(const LidarRequest& request, const dem::Terrain& terrain, RenderCache& cache,
                        const StopToken& stop);

// Upper bound on memory for a scan's returns and for their work, per beam.
inline constexpr std::size_t kBytesOfBeam = 220;

}  // namespace selenograph::engine
