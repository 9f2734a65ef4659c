// The craters of a detail that contain the points hit by a lidar's beams.
#pragma once

#include <cstdint>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/features.h"
#include "engine/lidar/lidar.h"

namespace selenograph::engine {

// Returns for each point (MOON_ME, m; NaN: no hit) the id of the smallest crater whose rim encloses it, 0: none. Throws
// ImpossibleRequest (member "craters") if the law has too many craters around the points, and Cancelled.
std::vector<std::uint64_t> find_enclosing_craters(const std::vector<Vec3>& points_m, const LidarCraters& options,
                                                  const dem::CraterSurvey& survey, const StopToken& stop);

}  // namespace selenograph::engine
