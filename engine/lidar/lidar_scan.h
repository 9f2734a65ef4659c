// A lidar's scan: beams against the finest terrain with detail, rocks and objects. POST /v1/lidar.
#pragma once

#include <cstddef>

#include "engine/lidar/lidar.h"

namespace selenograph::engine {

struct RenderContext;

// Returns the echoes of a scan. The same request on the same terrain gives the same numbers. Throws
// ImpossibleRequest if the instrument is below the terrain or inside an object at any tested pulse, TooMuchTerrain if a
// single beam runs along more terrain than memory holds, Cancelled when stopped.
LidarReturns scan_lidar(const LidarRequest& request, const RenderContext& context);

// Upper bound on memory for a scan's returns and for their work, per beam.
inline constexpr std::size_t kBytesOfBeam = 220;

}  // namespace selenograph::engine
